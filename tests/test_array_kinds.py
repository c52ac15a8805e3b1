"""Arrays of other libraries are taken and answered in their kind."""

import numpy as np
import pytest

import omnisight as om
from omnisight.array_kinds import like, to_numpy

CAMERA = om.fisheye((320, 240), 200)
POINTS = np.random.default_rng(0).normal(size=(4, 5, 3))


class Foreign:
    """An array of the array API standard with a device, as CuPy and JAX have them, in plain NumPy."""

    def __init__(self, values, device="chip"):
        self.values, self.device, self.dtype = np.asarray(values), device, np.asarray(values).dtype

    def __dlpack__(self, **_):
        raise BufferError("the memory of another device")

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype)

    def __array_namespace__(self):
        return self

    def asarray(self, values, dtype=None, device=None):
        return Foreign(np.asarray(getattr(values, "values", values), dtype), device or self.device)


def test_an_array_of_the_array_api_is_answered_in_kind():
    pixels, valid = CAMERA.project(Foreign(POINTS.astype(np.float32), device="chip 1"))
    assert isinstance(pixels, Foreign)
    assert isinstance(valid, Foreign)
    assert (pixels.device, pixels.dtype, valid.dtype) == ("chip 1", np.float32, np.bool_)
    np.testing.assert_allclose(pixels.values, CAMERA.project(POINTS)[0], rtol=1e-4, equal_nan=True)


def test_numpy_arrays_and_lists_are_not_converted():
    assert to_numpy(POINTS) is POINTS
    assert like([1.0], POINTS) is POINTS
    assert isinstance(CAMERA.project([0.0, 0.1, 1.0])[0], np.ndarray)


def test_tensors_of_torch_are_answered_by_tensors():
    torch = pytest.importorskip("torch")
    points = torch.from_numpy(POINTS.astype(np.float32))
    pixels, valid = CAMERA.project(points)
    assert (pixels.dtype, valid.dtype) == (torch.float32, torch.bool)
    expected, visible = CAMERA.project(POINTS)
    np.testing.assert_allclose(pixels.numpy(), expected, rtol=1e-4, equal_nan=True)
    assert np.array_equal(valid.numpy(), visible)
    bearings, _ = CAMERA.unproject(pixels)
    np.testing.assert_allclose(torch.linalg.norm(bearings, dim=-1)[valid].numpy(), 1, atol=1e-6)
    images = torch.randint(0, 255, (2, 240, 320, 3), dtype=torch.uint8)
    views = om.remap(images, CAMERA, om.perspective((64, 48)))
    assert views.dtype == torch.uint8
    assert tuple(views.shape) == (2, 48, 64, 3)
    assert np.array_equal(views.numpy(), om.remap(images.numpy(), CAMERA, om.perspective((64, 48))))
    with pytest.raises(ValueError, match="requires gradients, which are not computed here: pass"):
        CAMERA.project(points.requires_grad_())


def test_arrays_of_jax_are_answered_by_arrays_of_jax():
    jax = pytest.importorskip("jax")
    pixels, valid = CAMERA.project(jax.numpy.asarray(POINTS))
    assert isinstance(pixels, jax.Array)
    assert isinstance(valid, jax.Array)
    np.testing.assert_allclose(np.asarray(pixels), CAMERA.project(POINTS)[0], rtol=1e-4, equal_nan=True)


def test_a_batch_is_remapped_like_its_images():
    images = np.random.default_rng(1).integers(0, 255, (3, 240, 320, 3)).astype(np.uint8)
    remapper = om.Remapper(CAMERA, om.perspective((64, 48), 100), om.look(yaw=20))
    assert np.array_equal(remapper(images), np.stack([remapper(image) for image in images]))
    assert remapper(images[..., :1]).shape == (3, 48, 64, 1)
    assert remapper(images[:0]).shape == (0, 48, 64, 3)
    with pytest.raises(ValueError, match="or a batch"):
        remapper(images[..., None])


def test_a_list_of_images_and_gray_batches_are_remapped_like_their_images():
    images = np.random.default_rng(1).integers(0, 255, (3, 240, 320)).astype(np.uint8)
    remapper = om.Remapper(CAMERA, om.perspective((64, 48), 100))
    expected = np.stack([remapper(image) for image in images])
    assert np.array_equal(remapper(images), expected)
    assert np.array_equal(om.remap(list(images), CAMERA, om.perspective((64, 48), 100)), expected)
    with pytest.raises(ValueError, match="list of images that are arrays"):
        remapper([[1, 2], [3, 4]])
    with pytest.raises(ValueError, match="must have one shape"):
        remapper([images[0], images[1, :, :100]])


def test_images_of_other_libraries_are_written_and_searched(tmp_path):
    image = np.random.default_rng(2).integers(0, 255, (60, 80, 3)).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    om.write_image(tmp_path / "image.png", Foreign(image))
    assert np.array_equal(om.read_image(tmp_path / "image.png"), image)
    camera, options = om.perspective((320, 240), 90), om.FeatureOptions(surface="image", max_keypoints=50)
    mask = np.arange(320) < np.full((240, 1), 160)
    found, expected = (
        om.detect_features(kind(image), camera, options, mask=kind(mask)) for kind in (Foreign, np.array)
    )
    assert len(found) > 10
    assert np.array_equal(found.pixels, expected.pixels)
    with pytest.raises(ValueError, match="must be an array"):
        om.detect_features(5, camera)
