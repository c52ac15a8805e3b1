"""Cameras in torch on a GPU: equal to those on the CPU. Skipped where there is none."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
if not torch.cuda.is_available():
    pytest.skip("needs a GPU", allow_module_level=True)

import omnisight as om
from every_model import every_camera, inside
from omnisight.torch import Camera, Pose

SIZE = (640, 480)


def both_cameras(model):
    return [Camera(om.Camera(model, SIZE), device=device).requires_grad_(True) for device in ("cpu", "cuda")]


def assert_equal(of_gpu, of_cpu, relative):
    """Compare with a tolerance relative to the largest value: a derivative is a sum over all points."""
    scale = 1 + of_cpu.abs().max().item()
    torch.testing.assert_close(of_gpu.cpu(), of_cpu, rtol=relative, atol=relative * scale, equal_nan=True)


def assert_values_and_derivatives_equal(model, dtype, tolerance, *, is_compiled=False):
    bearings = inside(model, share=0.9, count=40)[1:]
    for function, given in (("project", bearings), ("unproject", model.project(bearings)[0])):
        results = []
        for camera in both_cameras(model):
            if is_compiled:
                camera.compile()
            at = torch.tensor(given, dtype=dtype, device=camera.grid().device, requires_grad=True)
            values, valid = getattr(camera, function)(at)
            assert valid.all()
            assert values.device == at.device
            weights = torch.tensor(np.random.default_rng(0).normal(size=values.shape), dtype=dtype).to(at.device)
            results.append((values, *torch.autograd.grad(values, [at, *camera.parameters()], weights)))
        for of_cpu, of_gpu in zip(*results, strict=True):
            assert_equal(of_gpu.detach(), of_cpu.detach(), tolerance)


every_type = pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 1e-3)])


@every_camera
@every_type
def test_values_and_derivatives_equal_those_of_the_cpu(model, dtype, tolerance):
    assert_values_and_derivatives_equal(model, dtype, tolerance)


# One of each kind of formula: each takes up to 20 s.
@pytest.mark.parametrize("name", ["double_sphere", "equirectangular", "mei", "spline"])
@every_type
@pytest.mark.filterwarnings("ignore")  # of the compiler itself
def test_a_compiled_camera_equals_the_cpu(name, dtype, tolerance):
    assert_values_and_derivatives_equal(om.model_class(name).example(), dtype, tolerance, is_compiled=True)


@every_camera
def test_validity_equals_that_of_numpy(model):
    points = np.random.default_rng(0).normal(size=(4000, 3))
    expected, expected_valid = model.project(points)
    pixels, valid = both_cameras(model)[1].project(torch.tensor(points, device="cuda"))
    np.testing.assert_array_equal(valid.cpu(), expected_valid)
    np.testing.assert_allclose(pixels.detach().cpu(), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("is_compiled", [False, True])
@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("target", [om.perspective((160, 120), 90), om.sphere(100), om.fisheye(40)])
@pytest.mark.filterwarnings("ignore")  # of the compiler itself
def test_remaps_equal_those_of_the_cpu(target, antialias, is_compiled):
    image = torch.rand(2, 3, 128, 256, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    rotation, views = torch.tensor(om.look(yaw=150, pitch=20)), []
    for device in ("cpu", "cuda"):
        source = Camera(om.sphere(256), device=device)
        if is_compiled:
            source.compile()
        moved = image.to(device), Camera(target, device=device), rotation.to(device)
        views.append(source.remap(*moved, antialias=antialias))
    torch.testing.assert_close(views[1][0].cpu(), views[0][0], rtol=0, atol=1e-5)
    assert torch.equal(views[1][1].cpu(), views[0][1])


def test_the_domain_follows_the_parameters():
    model = om.model_class("kannala_brandt").example().with_values({"k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0})
    camera = Camera(om.Camera(model, SIZE), device="cuda")
    point = torch.tensor([np.sin(2.0), 0.0, np.cos(2.0)], device="cuda")
    assert camera.project(point)[1]
    with torch.no_grad():
        camera.k1 -= 0.15  # the radius decreases beyond 85 degrees
    assert not camera.project(point)[1]


def test_a_camera_and_a_pose_are_refined():
    truth = om.model_class("kannala_brandt").example()
    rng = np.random.default_rng(0)
    points = torch.tensor(rng.normal(size=(500, 3)) * (1, 1, 0.3) + (0, 0, 2.0), device="cuda")
    start = om.Pose(om.look(yaw=1), np.array([0.02, 0.0, 0.0]))
    with torch.no_grad():
        seen, _ = Camera(om.Camera(truth, SIZE), device="cuda").project(points)
    camera, pose = Camera(om.Camera(truth.with_values({"k1": truth.k1 + 0.01}), SIZE), device="cuda"), Pose(start)
    pose.to("cuda")
    optimizer = torch.optim.LBFGS([camera.k1, pose.w, pose.t], max_iter=200, line_search_fn="strong_wolfe")

    def cost():
        optimizer.zero_grad()
        loss = (camera.project(pose(points))[0] - seen).square().mean()
        loss.backward()
        return loss

    optimizer.step(cost)
    assert cost().item() < 1e-6
    assert camera.numpy().model.k1 == pytest.approx(truth.k1, abs=1e-5)
