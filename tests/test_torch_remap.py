"""Remaps in torch: equal to those of NumPy, across the seam, averaged where the view is smaller, differentiable."""

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

import omnisight as om
from omnisight.torch import Camera, sample
from uncompiled_kernels import run_uncompiled_kernels

RIM = om.fisheye(240, fov=200)


@pytest.fixture(params=[True, False], ids=["with derivatives", "without"])
def derivatives(request):
    with torch.set_grad_enabled(request.param):
        yield


differentiable_or_not = pytest.mark.usefixtures("derivatives")


@pytest.fixture(scope="module")
def image():
    """Return a smooth panorama (128, 256, 3) of the sphere without a seam, 0 to 1."""
    bearings, _ = om.sphere(256).unproject(np.stack(np.meshgrid(np.arange(256), np.arange(128)), -1))
    return 0.5 + 0.4 * np.sin(3 * bearings)


def tensor_of(image):
    return torch.tensor(np.ascontiguousarray(image.transpose(2, 0, 1)), dtype=torch.float64)


def array_of(view):
    return view.detach().numpy().transpose(1, 2, 0)


@differentiable_or_not
@pytest.mark.parametrize(
    "target", [om.perspective((160, 120), 90), om.sphere(200), om.cube_face(64), om.fisheye(100), om.cylinder(160)]
)
def test_views_equal_those_of_numpy(image, target):
    source = om.sphere(256)
    rotation = om.look(yaw=150, pitch=20)
    expected = om.remap(image, source, target, rotation)
    view, valid = Camera(source).remap(tensor_of(image), Camera(target), torch.tensor(rotation))
    assert valid.any()
    # OpenCV rounds coordinates to 1/32 px.
    assert np.abs(array_of(view) - expected)[valid.numpy()].max() < 0.02


@differentiable_or_not
def test_a_view_across_the_seam_is_as_smooth_as_elsewhere(image):
    camera, target = Camera(om.sphere(256)), Camera(om.perspective((90, 60), 60))
    for antialias in (False, True):
        back, valid = camera.remap(tensor_of(image), target, torch.tensor(om.look(yaw=180)), antialias=antialias)
        assert valid.all()
        expected = 0.5 + 0.4 * np.sin(
            3 * om.perspective((90, 60), 60).unproject(target.grid().numpy())[0] @ om.look(yaw=180)
        )
        assert np.abs(array_of(back) - expected).max() < 0.005


@differentiable_or_not
def test_a_smaller_view_is_averaged():
    rng = np.random.default_rng(0)
    noise = rng.uniform(size=(480, 640, 1))
    source, target = om.perspective((640, 480), 80), om.perspective((40, 30), 80)
    averaged = array_of(Camera(source).remap(tensor_of(noise), Camera(target))[0])
    aliased, _ = Camera(source).remap(tensor_of(noise), Camera(target), antialias=False)
    assert aliased.std() > 0.12
    assert averaged.std() < 0.03
    assert averaged.mean() == pytest.approx(0.5, abs=0.01)
    # At the border the NumPy view is blended with the border value 0.
    interior = np.s_[1:-1, 1:-1]
    np.testing.assert_allclose(averaged[interior], om.remap(noise, source, target)[interior], rtol=0, atol=1e-6)


@differentiable_or_not
def test_pixels_outside_the_image_are_zero_and_not_valid():
    camera = Camera(RIM)
    image = torch.ones(2, 3, 240, 240)
    view, valid = camera.remap(image, Camera(om.sphere(128)))
    assert view.shape == (2, 3, 64, 128)
    assert valid.shape == (64, 128)
    assert 0.4 < valid.double().mean() < 0.8
    torch.testing.assert_close(view[..., valid], torch.ones_like(view[..., valid]))
    assert (view[..., ~valid] == 0).all()


@differentiable_or_not
def test_batches_of_rotations():
    camera, target = Camera(RIM), Camera(om.perspective((32, 24), 50))
    image = torch.rand(3, 240, 240, generator=torch.Generator().manual_seed(0))
    rotations = torch.stack([torch.tensor(om.look(yaw=yaw), dtype=torch.float32) for yaw in (0, 40)])
    views, valid = camera.remap(image, target, rotations)
    assert views.shape == (2, 3, 24, 32)
    assert valid.shape == (2, 24, 32)
    for rotation, view in zip(rotations, views, strict=True):
        torch.testing.assert_close(camera.remap(image, target, rotation)[0], view, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("target", [om.perspective((80, 60), 90), om.sphere(60), om.fisheye(40)])
@pytest.mark.parametrize("leads", [((), ()), ((2,), ()), ((), (3,)), ((3,), (3,)), ((1, 2), (3, 1))], ids=str)
def test_the_kernel_of_a_gpu_equals_the_cpu(leads, target, antialias, monkeypatch):
    images, rotations = leads
    image = torch.rand(*images, 3, 128, 256, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    turns = [om.look(yaw=150 + 40 * k, pitch=20) for k in range(int(np.prod(rotations)))]
    rotation = torch.tensor(np.array(turns)).reshape(*rotations, 3, 3)

    def remapped():
        with torch.no_grad():
            return Camera(om.sphere(256)).remap(image, Camera(target), rotation, antialias=antialias)

    view, valid = remapped()
    run_uncompiled_kernels(monkeypatch)
    of_kernel, valid_of_kernel = remapped()
    assert view.shape == (*torch.broadcast_shapes(images, rotations), 3, *target.size[::-1])
    torch.testing.assert_close(of_kernel, view, rtol=0, atol=1e-6)
    assert torch.equal(valid_of_kernel, valid)


def test_derivatives_by_image_pixels_parameters_and_rotation():
    camera, target = Camera(om.fisheye(24, fov=220)), Camera(om.fisheye(9, fov=200))
    image = torch.rand(2, 24, 24, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    rotation = torch.tensor(om.look(yaw=10, pitch=5))

    def remapped(image, rotation, fx, cy):
        m = torch.func.functional_call(Remapped(camera, target), {"source.fx": fx, "target.cy": cy}, (image, rotation))
        return m

    inputs = tuple(x.detach().clone().requires_grad_(True) for x in (image, rotation, camera.fx, target.cy))
    assert torch.autograd.gradcheck(remapped, inputs, eps=1e-7, atol=1e-4)
    pixels = (23 * torch.rand(5, 6, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(2))).requires_grad_(
        True
    )
    assert torch.autograd.gradcheck(lambda i, p: sample(i, p, periodic=True), (inputs[0], pixels), eps=1e-7, atol=1e-4)


class Remapped(torch.nn.Module):
    def __init__(self, source, target):
        super().__init__()
        self.source, self.target = source, target

    def forward(self, image, rotation):
        return self.source.remap(image, self.target, rotation, antialias=False)[0]


@pytest.mark.filterwarnings("ignore")  # of the compiler itself
def test_a_compiled_remap_is_one_graph(image):
    camera, target = Camera(om.sphere(256)), Camera(om.fisheye(60))
    torch._dynamo.reset()
    compiled = torch.compile(camera.remap, fullgraph=True, backend="aot_eager")
    rotation = torch.eye(3, dtype=torch.float64)
    view, valid = compiled(tensor_of(image), target, rotation)
    expected, expected_valid = camera.remap(tensor_of(image), target, rotation)
    assert torch.equal(valid, expected_valid)
    torch.testing.assert_close(view, expected, rtol=0, atol=1e-6)


def test_the_size_of_the_image_is_checked():
    with pytest.raises(ValueError, match="the image is 100x240 px, but its camera 240x240"):
        Camera(RIM).remap(torch.ones(3, 240, 100), Camera(RIM))


def test_the_mipmaps_are_those_of_opencv():
    from omnisight.torch.sampling import _halved

    image = np.random.default_rng(0).uniform(size=(33, 50))
    np.testing.assert_allclose(_halved(torch.tensor(image)[None, None])[0, 0], cv2.pyrDown(image), atol=1e-12)
