"""Corner fits: accuracy, covariance, and failure where there is no corner."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from omnisight.targets.subpixel.corner_fit import fit_corners

TILE = 44
FINE = 6  # samples per pixel and axis
STEP = 22.0  # px to the next corner
LIGHT, AMPLITUDE = 128.0, 70.0


@dataclass(frozen=True)
class Corner:
    """Two edges that start at angles `along` (radians) and bend by `bend` (px per px squared) cross in a tile."""

    place: tuple[float, float]
    along: tuple[float, float]
    bend: tuple[float, float] = (0.0, 0.0)
    bright: bool = True  # the square ahead, between both directions
    amplitude: float = AMPLITUDE
    slope: tuple[float, float] = (0.0, 0.0)

    @property
    def directions(self):
        return np.stack([np.cos(self.along), np.sin(self.along)], axis=1)

    @property
    def normals(self):
        return self.directions[:, ::-1] * [-1, 1]


def draw(corner, blur=0.8):
    """Return the tile of a corner: every pixel is the mean light over its square, edges sharper than a sample."""
    at = ((np.arange(TILE * FINE) + 0.5) / FINE - 0.5).astype(np.float32)
    x, y = at[None] - np.float32(corner.place[0]), at[:, None] - np.float32(corner.place[1])
    signs = []
    for (a, b), (n, m), bend in zip(corner.directions.tolist(), corner.normals.tolist(), corner.bend, strict=True):
        away = n * x + m * y
        if bend:
            away -= bend * (a * x + b * y) ** 2
        signs.append(np.clip(2 * FINE * away, -1, 1))
    # Ahead lies on the far side of one edge and on the near side of the other.
    fine = -signs[0] * signs[1] * (1 if corner.bright else -1)
    if blur:
        fine = cv2.GaussianBlur(fine, (0, 0), blur * FINE, borderType=cv2.BORDER_REPLICATE)
    tile = fine.reshape(TILE, FINE, TILE, FINE).mean(axis=(1, 3))
    x, y = np.meshgrid(np.arange(TILE) - corner.place[0], np.arange(TILE) - corner.place[1])
    return LIGHT + corner.amplitude * tile + corner.slope[0] * x + corner.slope[1] * y


def sheet(corners, *, blur=0.8, noise=0.0, seed=0, bends_known=True):
    """Return the arguments of the fit for one image of many corners, and where they are; the start is a little off."""
    rng = np.random.default_rng(seed)
    image = np.concatenate([draw(corner, blur) for corner in corners], axis=1)
    image = image + 255 * noise * rng.standard_normal(image.shape)
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    truth = np.array([corner.place for corner in corners]) + np.outer(np.arange(len(corners)), [TILE, 0])
    steps = STEP * np.array([corner.directions for corner in corners])
    bends = np.array([STEP**2 * np.array(corner.bend)[:, None] * corner.normals for corner in corners])
    start = truth + rng.uniform(-1, 1, truth.shape)
    return (image, start, steps, bends * bends_known), truth


def corners(count, *, seed=0, oblique=True, bent=0.0):
    """Return corners anywhere in a pixel, turned at random, of angles from 50 to 130 degrees."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        first = rng.uniform(-np.pi, np.pi)
        between = np.radians(rng.uniform(50, 130)) if oblique else np.pi / 2
        made.append(
            Corner(
                tuple(TILE / 2 + rng.uniform(-0.5, 0.5, 2)),
                (first, first + rng.choice([-1, 1]) * between),
                tuple(rng.uniform(-bent, bent, 2)),
                bool(rng.random() < 0.5),
            )
        )
    return made


def rms(error):
    return float(np.sqrt((error**2).sum(axis=1).mean()))


CONDITIONS = [
    # oblique, bent (px per px squared), blur (px), noise, rms error allowed (px), bias allowed (px)
    (False, 0.0, 0.0, 0.0, 0.02, 0.004),
    (False, 0.0, 0.8, 0.0, 0.005, 0.001),
    (True, 0.0, 0.0, 0.0, 0.02, 0.004),
    (True, 0.0, 0.8, 0.0, 0.005, 0.001),
    (True, 0.0, 2.0, 0.0, 0.01, 0.002),
    (True, 0.008, 0.8, 0.0, 0.015, 0.003),
    (False, 0.0, 0.8, 0.02, 0.035, 0.01),
    (True, 0.0, 0.5, 0.05, 0.07, 0.02),
    (True, 0.0, 0.8, 0.02, 0.035, 0.01),
    (True, 0.0, 2.0, 0.02, 0.07, 0.02),
    (True, 0.008, 0.8, 0.02, 0.04, 0.01),
    (True, 0.008, 1.2, 0.05, 0.1, 0.03),
]


@pytest.mark.parametrize(("oblique", "bent", "blur", "noise", "most", "bias"), CONDITIONS)
def test_corner_errors_are_small_and_match_their_covariance(oblique, bent, blur, noise, most, bias):
    shown = corners(80, oblique=oblique, bent=bent)
    arguments, truth = sheet(shown, blur=blur, noise=noise)
    found = fit_corners(*arguments)
    error = found.pixels - truth
    assert rms(error) < most
    assert np.abs(error.mean(axis=0)).max() < bias
    assert np.abs(error).max() < 5 * most
    # Squared errors over what the covariance expects: 1 on average. Without noise rounding is left, and the print.
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error) / 2
    assert (0.7 if noise else 0) < normalised.mean() < (1.4 if noise else 3)
    np.testing.assert_array_equal(found.covariance, np.swapaxes(found.covariance, 1, 2))
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    assert ((found.amplitude > 0) == [corner.bright for corner in shown]).all()
    assert np.abs(found.amplitude) == pytest.approx(AMPLITUDE, rel=0.05 + 3 * noise)
    assert found.explained.min() > 0.85
    if blur:  # a pixel, being a square, blurs too
        assert np.median(found.blur) == pytest.approx(np.hypot(blur, 12**-0.5), rel=0.1)


def test_covariance_is_largest_along_the_bisector_of_an_acute_angle():
    """Two edges at 50 degrees determine their crossing worst along their bisector."""
    arguments, _ = sheet([Corner((22, 22), (0.3, 0.3 + np.radians(50)))] * 3, noise=0.03)
    covariances = fit_corners(*arguments).covariance
    assert covariances.shape == (3, 2, 2)
    for covariance in covariances:
        _, axes = np.linalg.eigh(covariance)
        assert abs(axes[:, 1] @ [np.cos(0.3 + np.radians(25)), np.sin(0.3 + np.radians(25))]) > 0.98


def test_known_bends_remove_the_bias_of_curved_edges():
    shown = corners(30, bent=0.008)
    known, truth = sheet(shown)
    unknown, _ = sheet(shown, bends_known=False)
    with_bends, without = (rms(fit_corners(*arguments).pixels - truth) for arguments in (known, unknown))
    assert with_bends < 0.2 * without


def test_light_gradient_does_not_move_the_corner():
    plain = corners(30)
    slanted = [Corner(c.place, c.along, c.bend, c.bright, slope=(1.5, -1.0)) for c in plain]
    arguments, truth = sheet(slanted)
    assert rms(fit_corners(*arguments).pixels - truth) < 0.01


def test_sigma_is_proportional_to_noise_over_contrast():
    def sigma(noise, amplitude):
        shown = [Corner(c.place, c.along, amplitude=amplitude) for c in corners(20)]
        found = fit_corners(*sheet(shown, noise=noise)[0])
        return np.sqrt(np.median(found.covariance[:, 0, 0]))

    assert sigma(0.04, 70) == pytest.approx(2 * sigma(0.02, 70), rel=0.2)
    assert sigma(0.02, 35) == pytest.approx(2 * sigma(0.02, 70), rel=0.2)


@pytest.mark.parametrize(("over", "most"), [(0.5, 1.4), (1.0, 2.2)])
def test_correlated_noise_inflates_the_covariance(over, most):
    """The covariance of noise blurred over a pixel is too small by two at most, instead of by more than ten."""
    arguments, truth = sheet(corners(80), noise=0.0)
    rough = cv2.GaussianBlur(np.random.default_rng(5).standard_normal(arguments[0].shape), (0, 0), over)
    spoilt = np.clip(np.rint(arguments[0] + 5 * rough / rough.std()), 0, 255).astype(np.uint8)
    found = fit_corners(spoilt, *arguments[1:])
    error = found.pixels - truth
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error) / 2
    assert 0.7 < normalised.mean() < most
    assert rms(error) > 0.03  # more than noise of its own in every pixel would make


def test_rough_fit_is_good_to_a_tenth_of_a_pixel():
    arguments, truth = sheet(corners(80), noise=0.02)
    found = fit_corners(*arguments, rough=True)
    assert rms(found.pixels - truth) < 0.1
    assert np.isfinite(found.covariance).all()


def nothing(found):
    """Return which corners were not fitted; all their values must be NaN."""
    missing = np.isnan(found.pixels).any(axis=1)
    for array in found:
        assert np.isnan(array[missing]).all()
        assert np.isfinite(array[~missing]).all()
    return missing


def at(places, angle=0.2, step=STEP, between=np.pi / 2):
    places = np.atleast_2d(np.asarray(places, float))
    along = np.array([[np.cos(a), np.sin(a)] for a in (angle, angle + between)])
    steps = np.broadcast_to(step * along, (len(places), 2, 2))
    return places, steps, np.zeros_like(steps)


def images_without_corners():
    v, u = np.mgrid[:60, :60]
    noise = np.random.default_rng(1).normal(0, 12, (60, 60))
    edge = 128 + 70 * np.tanh((u * np.cos(0.2) + v * np.sin(0.2) - 36.3) / 1.5)
    return {
        "flat": np.full((60, 60), 128.0),
        "noise": 128 + noise,
        "edge": edge,
        "noisy edge": edge + noise,
        "line": 200 - 120 * np.exp(-(((u - 30) / 2.0) ** 2)),
        "disc": 200.0 - 120 * (np.hypot(u - 30, v - 30) < 6),
        "L": 200.0 - 120 * ((u > 30) & (v > 30)),
        "slope": 40.0 + 2 * u + v,
    }


@pytest.mark.parametrize("kind", images_without_corners())
@pytest.mark.parametrize("angle", [0.0, 0.2, 0.8])
def test_other_patterns_give_no_fit_or_a_poor_one(kind, angle):
    image = np.clip(np.rint(images_without_corners()[kind]), 0, 255).astype(np.uint8)
    found = fit_corners(image, *at([[30, 30], [30.4, 29.1], [28, 31]], angle))
    missing = nothing(found)
    assert (missing | (found.explained < 0.85) | (np.abs(found.amplitude) < 5)).all()


def test_corners_outside_of_the_image_or_at_its_border_are_not_fitted():
    (image, *_), _ = sheet([Corner((21.6, 22.3), (0.2, 0.2 + np.pi / 2))], noise=0.01)
    outside = [[-5, 20], [20, -5], [TILE + 5, 20], [20, TILE + 900], [-1e9, 1e9], [np.nan, 20], [20, np.inf]]
    assert nothing(fit_corners(image, *at(outside))).all()
    for cut in (21, 23):  # the corner is nearer to the edge than can be measured, or outside
        assert nothing(fit_corners(image[:, cut:], *at([21.6 - cut, 22.3]))).all()
    # Where most of the window is left, so is the corner; where two edges cut it, it is not.
    found = fit_corners(image[:, 17:], *at([4.4, 22.5]))
    assert np.abs(found.pixels - [4.6, 22.3]).max() < 0.05
    assert nothing(fit_corners(image[18:, 17:], *at([4.6, 4.3]))).all()


@pytest.mark.parametrize("wrong", ["place", "step", "bend", "short", "parallel", "away"])
def test_invalid_start_gives_nan_and_does_not_affect_other_corners(wrong):
    (image, start, steps, bends), truth = sheet(corners(3, seed=4))
    match wrong:
        case "place":
            start[1, 0] = np.nan
        case "step":
            steps[1, 0] = np.nan
        case "bend":
            bends[1, 1] = np.inf
        case "short":
            steps[1] *= 0.1
        case "parallel":
            steps[1, 1] = steps[1, 0] + 0.1
        case "away":
            start[1] += 16
    found = fit_corners(image, start, steps, bends)
    np.testing.assert_array_equal(nothing(found), [False, True, False])
    assert np.abs((found.pixels - truth)[[0, 2]]).max() < 0.02


def test_squares_of_six_pixels_are_enough():
    fine = [Corner(c.place, c.along) for c in corners(40, oblique=False)]
    (image, start, steps, bends), truth = sheet(fine, noise=0.02)
    found = fit_corners(image, truth + 0.3 * (start - truth), steps * (6 / STEP), bends)
    assert np.isfinite(found.pixels).all()
    assert rms(found.pixels - truth) < 0.15


@pytest.mark.parametrize("size", [(0, 0), (1, 1), (1, 40), (40, 1), (2, 2), (3, 5), (8, 8)])
def test_tiny_images_give_no_fit(size):
    image = np.random.default_rng(0).integers(0, 256, size, dtype=np.uint8)
    assert nothing(fit_corners(image, *at([[0, 0], [2, 2], [4, 4]]))).all()


def test_no_corners_give_empty_arrays():
    found = fit_corners(np.zeros((9, 9), np.uint8), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2, 2)))
    assert [array.shape for array in found] == [(0, 2), (0, 2, 2), (0,), (0,), (0,)]


def test_memory_layout_does_not_matter_and_inputs_do_not_change():
    arguments, _ = sheet(corners(6), noise=0.02)
    expected = fit_corners(*arguments)
    wide = np.repeat(np.repeat(arguments[0], 2, axis=0), 2, axis=1)[::2, ::2]
    strange = [wide, *(np.asfortranarray(a) for a in arguments[1:])]
    turned = [np.asfortranarray(arguments[0]), *(a[::-1][::-1] for a in arguments[1:])]
    for given in (strange, turned):
        kept = [a.copy() for a in given]
        found = fit_corners(*given)
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9)
        for a, b in zip(given, kept, strict=True):
            np.testing.assert_array_equal(a, b)


def test_fit_is_equivariant_to_mirroring_and_transposing():
    (image, start, steps, bends), _ = sheet(corners(8, bent=0.006), noise=0.02)
    straight = fit_corners(image, start, steps, bends)
    last = image.shape[1] - 1
    mirror = np.array([-1.0, 1.0])
    mirrored = fit_corners(image[:, ::-1], start * mirror + [last, 0], steps * mirror, bends * mirror)
    np.testing.assert_allclose(mirrored.pixels * mirror + [last, 0], straight.pixels, atol=0.005)
    np.testing.assert_allclose(mirrored.amplitude, straight.amplitude, rtol=0.01)
    swapped = fit_corners(image.T, start[:, ::-1], steps[..., ::-1], bends[..., ::-1])
    np.testing.assert_allclose(swapped.pixels[:, ::-1], straight.pixels, atol=0.005)
    # Exchanging the edges changes nothing; turning one round puts another square ahead.
    np.testing.assert_allclose(
        fit_corners(image, start, steps[:, ::-1], bends[:, ::-1]).amplitude, straight.amplitude, rtol=0.01
    )
    turned = steps * np.array([1, -1])[:, None]
    np.testing.assert_allclose(fit_corners(image, start, turned, bends).amplitude, -straight.amplitude, rtol=0.01)
