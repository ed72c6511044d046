"""LPIPS against the published values, and the weights it refuses."""

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import nn

from aa4d.errors import InputError
from aa4d.evaluation import lpips_weights
from aa4d.evaluation.lpips import STACKS, LearnedPerceptualSimilarity
from aa4d.evaluation.lpips_weights import LINEAR, NotAvailable, WeightsFile, load_lpips, obtain

GENUINE = Path(__file__).parents[2].parent / "shared/data/lpips"
needs_weights = pytest.mark.skipif(not GENUINE.is_dir(), reason="shared/data/lpips is not here")


def quiet(_done: int, _total: int) -> None:
    pass


@pytest.fixture
def genuine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AA4D_WEIGHTS", str(GENUINE))


def picture(name: str) -> torch.Tensor:
    return torch.from_numpy(np.array(Image.open(GENUINE / f"examples/{name}.png").convert("RGB"))).float() / 255


@needs_weights
@pytest.mark.usefixtures("genuine")
def test_alex_gives_the_published_values() -> None:
    """richzhang/PerceptualSimilarity, issue 120: 0.722 and 0.138 for the example images of that repository."""
    lpips = load_lpips("alex", download=False, progress=quiet)
    reference = picture("ex_ref")
    assert lpips(picture("ex_p0"), reference) == pytest.approx(0.722, abs=5e-4)
    assert lpips(picture("ex_p1"), reference) == pytest.approx(0.138, abs=5e-4)
    assert lpips(reference, reference) == 0


@needs_weights
@pytest.mark.usefixtures("genuine")
def test_squeeze_gives_the_published_values() -> None:
    """The docstring of torchmetrics 1.9.0, image/lpip.py: 0.1024 and 0.0938 for these two pairs in [-1, 1]."""
    lpips = load_lpips("squeeze", download=False, progress=quiet)
    generator = torch.Generator().manual_seed(42)
    a, b = (torch.rand(2, 3, 100, 100, generator=generator) for _ in range(2))
    values = [lpips(x.permute(1, 2, 0), y.permute(1, 2, 0)) for x, y in zip(a, b, strict=True)]
    assert values == pytest.approx([0.1024, 0.0938], abs=5e-5)


def test_vgg_has_the_layers_of_torchvisions_vgg16() -> None:
    """Its weights are not at hand here: the shapes of torchvision's file, and the taps after relu1_2 to relu5_3."""
    layers = STACKS["vgg"].layers()
    convolutions = [index for index, layer in enumerate(layers) if isinstance(layer, nn.Conv2d)]
    assert convolutions == [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]
    assert sum(p.numel() for p in layers.parameters()) == 14_714_688
    x = torch.zeros(1, 3, 32, 32)
    widths = []
    for index, layer in enumerate(layers):
        x = layer(x)
        if index in STACKS["vgg"].taps:
            assert isinstance(layer, nn.ReLU)
            widths.append((x.shape[1], x.shape[2]))
    assert widths == [(64, 32), (128, 16), (256, 8), (512, 4), (512, 2)]


@needs_weights
@pytest.mark.usefixtures("genuine")
def test_the_heads_of_vgg_fit_its_taps() -> None:
    heads = torch.load(GENUINE / LINEAR["vgg"].name, map_location="cpu", weights_only=True)
    lpips = LearnedPerceptualSimilarity("vgg", STACKS["vgg"].layers().state_dict(), heads)
    a, b = torch.rand(2, 32, 32, 3, generator=torch.Generator().manual_seed(0))
    assert lpips(a, b) > 0
    assert lpips(a, b) == pytest.approx(lpips(b, a))


@pytest.mark.parametrize("network", list(STACKS))
def test_the_smallest_image_is_the_smallest(network: Any) -> None:
    stack = STACKS[network]
    layers = stack.layers()
    assert layers(torch.zeros(1, 3, stack.smallest, stack.smallest)).numel()
    with pytest.raises(RuntimeError):
        layers(torch.zeros(1, 3, stack.smallest - 1, stack.smallest - 1))


def test_frames_too_small_for_a_network_are_not_measured() -> None:
    heads = {f"lin{i}.model.1.weight": torch.rand(1, c, 1, 1) for i, c in enumerate((64, 192, 384, 256, 256))}
    alex = LearnedPerceptualSimilarity("alex", STACKS["alex"].layers().state_dict(), heads)
    perceptual = lpips_weights.Perceptual({"alex": alex}, {})
    assert perceptual.for_size(40, 31) == perceptual
    small = perceptual.for_size(40, 30)
    assert small.loaded == {}
    assert "under 31 pixels" in small.missing["alex"]


def test_absent_weights_are_not_downloaded_unasked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path))
    monkeypatch.setattr("urllib.request.urlopen", lambda *_, **__: pytest.fail("asked the network"))
    sentence = obtain(None).missing["alex"]
    assert sentence.startswith(f"alexnet-owt-7be5be79.pth is not in {tmp_path};")
    assert "AA4D_WEIGHTS" in sentence


def test_a_folder_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path / "absent"))
    with pytest.raises(InputError, match="AA4D_WEIGHTS says that weights are there"):
        obtain(None)


def test_weights_with_another_hash_are_never_opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path))
    monkeypatch.setattr(torch, "load", lambda *_, **__: pytest.fail("opened"))
    (tmp_path / "alexnet_features.pth").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match=r"is not the genuine alexnet_features\.pth"):
        obtain(None)


class Response(io.BytesIO):
    """What urlopen returns."""

    def __init__(self, content: bytes) -> None:
        super().__init__(content)
        self.headers = {"Content-Length": str(len(content))}


def serve(monkeypatch: pytest.MonkeyPatch, content: bytes) -> list[str]:
    asked: list[str] = []

    def urlopen(url: str, timeout: float) -> Response:
        assert timeout > 0
        asked.append(url)
        return Response(content)

    monkeypatch.setattr("urllib.request.urlopen", urlopen)
    return asked


def test_a_download_is_kept_only_when_its_hash_is_right(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    content = b"weights" * 1000
    file = WeightsFile("a.pth", hashlib.sha256(content).hexdigest(), "https://example.org/a.pth")
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path))
    serve(monkeypatch, content[:-1])
    with pytest.raises(InputError, match="what came from https://example"):
        lpips_weights._obtain((file,), True, quiet)
    assert not list(tmp_path.iterdir())

    asked = serve(monkeypatch, content)
    seen: list[tuple[int, int]] = []
    path = lpips_weights._obtain((file,), True, lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == content
    assert seen[-1] == (len(content), len(content))
    assert lpips_weights._obtain((file,), True, quiet) == path
    assert asked == ["https://example.org/a.pth"]


def test_without_a_network_the_reason_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("Name or service not known")

    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path))
    monkeypatch.setattr("urllib.request.urlopen", refuse)
    with pytest.raises(NotAvailable, match="could not be downloaded"):
        load_lpips("vgg", download=True, progress=quiet)
    assert obtain(("vgg",)).missing.keys() == {"vgg"}
    assert not list(tmp_path.iterdir())
