"""Laws of the cameras in torch, for every registered camera model: values of NumPy, derivatives, compilation."""

from shutil import which

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import omnisight as om
from every_model import AZIMUTHS, direction, every_camera, every_model, inside, rim
from omnisight.torch import Camera, Pose
from omnisight.torch.domain_constants import kept_by_version, numpy_model
from uncompiled_kernels import run_uncompiled_kernels

SIZE = (640, 480)
# Points that no model projects.
ODD = [[0, 0, 0], [np.nan, 0, 1], [0, 0, np.inf], [-np.inf, 1, 1]]
FAR = [[np.nan, 0], [np.inf, 0], [1e300, -1e300]]


@pytest.fixture(params=["loops", "formulas", "kernels"])
def code(request, monkeypatch):
    """Run the compiled loops of the CPU, the formulas, or the functions of the kernels of a GPU without compilation."""
    if request.param == "formulas":
        monkeypatch.setattr("omnisight.torch.camera.fast_code", lambda *_: None)
    if request.param == "kernels":
        run_uncompiled_kernels(monkeypatch)


def camera_of(model, **options):
    return Camera(om.Camera(model, SIZE), **options).requires_grad_(True)


def to_the_rim(model):
    """Return bearings (N, 3) from the axis to the last millionth of the valid domain."""
    share = np.concatenate([np.linspace(0, 0.99, 60), 1 - np.geomspace(1e-6, 1e-2, 9)])
    return direction(share[:, None] * rim(model), AZIMUTHS).reshape(-1, 3)


def conditioning(model, bearings):
    """Return what a change of the bearing by some rounding errors makes in the pixel (N, 1)."""
    return 1e-14 * np.abs(model.project_with_jacobians(bearings)[2]).max(axis=(1, 2))[:, None]


@every_camera
@pytest.mark.usefixtures("code")
def test_values_agree_with_numpy(model):
    camera, bearings = camera_of(model), to_the_rim(model)
    pixels, valid = model.project(bearings)
    projected, projected_valid = camera.project(torch.tensor(bearings))
    np.testing.assert_array_equal(projected_valid.numpy(), valid)
    error, limit = np.abs(projected.detach().numpy() - pixels), conditioning(model, bearings)
    well_inside = 54 * len(AZIMUTHS)  # beyond, rounding of the cosine and of the pixel is magnified
    assert (error < 1e-12 * (1 + np.abs(pixels)) + limit)[:well_inside].all()
    # A rounding error of the cosine is one of the angle divided by the sine.
    limit = limit / np.linalg.norm(bearings[:, :2], axis=1, keepdims=True).clip(1e-300)
    assert (error < 1e-8 * (1 + np.abs(pixels)) + limit)[well_inside:].all()
    back, back_valid = camera.unproject(torch.tensor(pixels))
    assert back_valid.all()
    expected = model.unproject(pixels)[0]
    np.testing.assert_allclose(back.detach().numpy()[well_inside], expected[well_inside], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.detach().numpy(), expected, rtol=0, atol=1e-9)


@every_camera
@pytest.mark.usefixtures("code")
def test_float32_agrees_up_to_its_rounding(model):
    camera, bearings = camera_of(model), inside(model)
    pixels, valid = camera.project(torch.tensor(bearings, dtype=torch.float32))
    assert pixels.dtype == torch.float32
    assert valid.all()
    expected = model.project(bearings)[0]
    assert (
        np.abs(pixels.detach().numpy() - expected) < 1e-6 * (1 + np.abs(expected)) + 1e8 * conditioning(model, bearings)
    ).all()
    back, back_valid = camera.unproject(torch.tensor(expected, dtype=torch.float32))
    assert back.dtype == torch.float32
    assert back_valid.all()
    np.testing.assert_allclose(back.detach().numpy(), bearings, rtol=0, atol=2e-5)


def gradcheck(function, camera, values, *, second=False):
    """Check derivatives by the input and by relative changes of the parameters, whose scales differ by 1e12."""
    names, start = zip(*((name, p.detach().clone()) for name, p in camera.named_parameters()), strict=True)

    def of_relative_changes(array, *changes):
        changed = {
            name: p + torch.where(p == 0, 1e-3, p) * change
            for name, p, change in zip(names, start, changes, strict=True)
        }
        return torch.func.functional_call(
            Wrapped(camera, function), {f"camera.{n}": p for n, p in changed.items()}, array
        )

    inputs = values.clone().requires_grad_(True), *(torch.zeros_like(p, requires_grad=True) for p in start)
    check = torch.autograd.gradgradcheck if second else torch.autograd.gradcheck
    return check(of_relative_changes, inputs, eps=1e-7, atol=1e-4, rtol=1e-4, fast_mode=second)


class Wrapped(torch.nn.Module):
    def __init__(self, camera, function):
        super().__init__()
        self.camera, self.function = camera, function

    def forward(self, array):
        return getattr(self.camera, self.function)(array)[0]


@every_model
def test_derivatives_by_points_pixels_and_parameters(model):
    camera, bearings = camera_of(model), inside(model, share=0.9, count=16)
    assert model.theta_max < np.pi / 2 or np.arccos(bearings[:, 2]).max() > 0.7 * min(rim(model).min(), np.pi)
    assert gradcheck("project", camera, torch.tensor(1.3 * bearings))
    assert gradcheck("unproject", camera, torch.tensor(model.project(bearings)[0]))


@every_model
def test_second_derivatives_off_the_axis(model):
    camera, bearings = camera_of(model), inside(model, share=0.9, count=4)[1:]
    # A second derivative by the pixel is small: in units of 100 px it is not.
    pixels = torch.tensor(model.project(bearings)[0])
    assert gradcheck("project", camera, torch.tensor(bearings), second=True)
    assert gradcheck("unproject", camera, pixels, second=True)


@every_camera
@pytest.mark.usefixtures("code")
def test_invalid_points_and_the_axis_leave_all_derivatives_finite(model):
    camera = camera_of(model)
    theta = np.radians([0, 1e-9, 45, 90 - 1e-6, 90 + 1e-6, 120, 179.99, 180])[:, None]
    aside = [[1, 0, 0], [0, 1, 0], [-3, -4, 0], [0, 0, -1]]
    given = np.concatenate([direction(theta, AZIMUTHS).reshape(-1, 3), aside, ODD])
    points = torch.tensor(given, requires_grad=True)
    pixels, valid = camera.project(points)
    np.testing.assert_array_equal(valid.numpy(), model.project(given)[1])
    assert torch.isnan(pixels[~valid]).all()
    given = np.concatenate([pixels.detach().numpy()[valid.numpy()], FAR])
    at = torch.tensor(given, requires_grad=True)
    bearings, back_valid = camera.unproject(at)
    assert torch.isnan(bearings[~back_valid]).all()
    loss = torch.where(valid[:, None], pixels, 0).sum() + torch.where(back_valid[:, None], bearings, 0).sum()
    loss.backward()
    for value in (points, at, *camera.parameters()):
        assert torch.isfinite(value.grad).all()
    assert (points.grad[~valid] == 0).all()
    assert (at.grad[~back_valid] == 0).all()


@every_model
def test_derivatives_by_the_jacobians_are_those_of_the_formulas(model):
    camera, bearings = camera_of(model), inside(model, count=40)[1:]
    for function, given in ((camera.project, bearings), (camera.unproject, model.project(bearings)[0])):
        at = torch.tensor(given, requires_grad=True)
        values, _ = function(at)
        inputs = [at, *camera.parameters()]
        weights = torch.tensor(np.random.default_rng(0).normal(size=values.shape))
        of_jacobians = torch.autograd.grad(values, inputs, weights, retain_graph=True)
        of_formulas = torch.autograd.grad(values, inputs, weights, create_graph=True)
        for mine, expected in zip(of_jacobians, of_formulas, strict=True):
            torch.testing.assert_close(
                mine, expected.detach(), rtol=1e-8, atol=1e-9 * (1 + expected.abs().max().item())
            )


@pytest.mark.parametrize("name", ["kannala_brandt", "ocam", "mei", "equirectangular"])
@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")  # of torch itself
def test_transformations_of_torch_func(name):
    model = om.model_class(name).example()
    camera, bearings = camera_of(model), inside(model, count=6)[1:]
    for transformed in (torch.func.jacrev, torch.func.jacfwd):
        jacobians = torch.func.vmap(transformed(lambda point: camera.project(point)[0]))(torch.tensor(bearings))
        np.testing.assert_allclose(jacobians.detach(), model.project_with_jacobians(bearings)[2], rtol=1e-9, atol=1e-9)


# One of each kind of formula; the others take a minute more.
COMPILED_FIRST = {"double_sphere", "equirectangular", "kannala_brandt", "ocam", "spline"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in COMPILED_FIRST else pytest.mark.slow) for name in om.models.model_names()],
)
@pytest.mark.filterwarnings("ignore")  # of the compiler itself
def test_a_compiled_function_is_one_graph_with_the_same_results(name):
    model = om.model_class(name).example()
    camera = camera_of(model)
    bearings = torch.tensor(inside(model, share=0.98))

    def there_and_back(points):
        pixels, valid = camera.project(points)
        return (pixels, valid, *camera.unproject(pixels))

    torch._dynamo.reset()
    results = torch.compile(there_and_back, fullgraph=True, backend="eager")(bearings)
    for mine, expected in zip(results, there_and_back(bearings), strict=True):
        np.testing.assert_allclose(mine.detach().numpy(), expected.detach().numpy(), rtol=1e-12, atol=1e-9)
    results[2].sum().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in camera.parameters())


@pytest.mark.slow
@pytest.mark.skipif(which("g++") is None, reason="torch.compile needs a C++ compiler")
@pytest.mark.filterwarnings("ignore")
def test_generated_code_has_the_same_results():
    camera = camera_of(om.model_class("kannala_brandt").example())
    points = torch.tensor(inside(om.model_class("kannala_brandt").example()))
    torch._dynamo.reset()
    pixels, _ = torch.compile(camera.project, fullgraph=True)(points)
    np.testing.assert_allclose(pixels.detach(), camera.project(points)[0].detach(), rtol=1e-12)


def test_leading_shapes_types_and_errors():
    camera = Camera(om.Camera(om.model_class("ocam").example(), SIZE))
    for lead in ((), (5,), (2, 3, 4), (0,)):
        pixels, valid = camera.project(torch.ones(*lead, 3))
        assert pixels.shape == (*lead, 2)
        assert valid.shape == lead
        assert camera.unproject(pixels)[0].shape == (*lead, 3)
    for wrong in (torch.ones(4), torch.ones(3, dtype=torch.int64), torch.ones(3, dtype=torch.float16)):
        with pytest.raises(ValueError, match=r"points must be float32 or float64 of shape \(\.\.\., 3\)"):
            camera.project(wrong)
    with pytest.raises(ValueError, match="central camera"):
        Camera("camera.json")


def test_parameters_have_the_names_of_the_model_and_return_to_numpy():
    source = om.Camera(om.model_class("unified").example(), SIZE)
    camera = Camera(source)
    assert [name for name, _ in camera.named_parameters()] == ["fx", "fy", "cx", "cy", "xi", "skew"]
    assert not camera.skew.requires_grad
    assert camera.numpy().model == source.model
    with torch.no_grad():
        camera.xi += 0.01
    assert camera.numpy().model.xi == pytest.approx(source.model.xi + 0.01)
    copy = Camera(source)
    copy.load_state_dict(camera.state_dict())
    assert copy.numpy() == camera.numpy()


@pytest.mark.usefixtures("code")
def test_the_domain_follows_the_parameters():
    model = om.model_class("kannala_brandt").example().with_values({"k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0})
    camera = Camera(om.Camera(model, SIZE))
    point = torch.tensor(direction(2.0, 0.0))
    assert camera.project(point)[1]
    with torch.no_grad():
        camera.k1 -= 0.15  # the radius decreases beyond 85 degrees
    assert not camera.project(point)[1]
    parameters = [p.detach() for p in camera.parameters()]

    def kept():
        return kept_by_version(parameters, ("kannala_brandt",), lambda: numpy_model(parameters, "kannala_brandt"))

    before = kept()
    assert kept() is before
    with torch.no_grad():
        camera.k1 += 0.1
    assert kept().k1 == before.k1 + 0.1
    with torch.no_grad():
        camera.k1 *= torch.nan
    with pytest.raises(ValueError, match="kannala_brandt camera are not finite"):
        camera.project(point)


def test_a_pose_starts_where_it_should_and_moves():
    start = om.Pose(om.look(yaw=30), np.array([0.1, -0.2, 0.3]))
    pose, points = Pose(start), np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(pose(torch.tensor(points)).detach(), start @ points, atol=1e-12)
    with torch.no_grad():
        pose.w += torch.tensor([0.2, -0.1, 0.3], dtype=torch.float64)
        pose.t += 0.5
    moved = start.moved([0.2, -0.1, 0.3, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(pose.numpy().matrix, moved.matrix, atol=1e-12)
    assert torch.autograd.gradcheck(
        lambda w, t: torch.func.functional_call(pose, {"w": w, "t": t}, torch.tensor(points)), (pose.w, pose.t)
    )
