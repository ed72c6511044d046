"""The genuine weights of LPIPS: where they lie, what proves them, how they are read.

A weights file is taken only if its SHA-256 is one of those below, and is then read by torch's restricted loader, which
builds tensors and runs no code.
"""

from __future__ import annotations

import hashlib
import http.client
import os
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from aa4d.errors import InputError
from aa4d.evaluation.lpips import LearnedPerceptualSimilarity, Network
from aa4d.files import make_folder, whole_file

VARIABLE = "AA4D_WEIGHTS"
TIMEOUT_S = 20.0
CHUNK = 1 << 20

# What the download tells whoever watches: bytes done, bytes in all.
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class WeightsFile:
    name: str
    sha256: str
    url: str | None = None  # None: cannot be downloaded, but is taken where it lies


TORCHVISION = "https://download.pytorch.org/models/"
HEADS = "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/master/lpips/weights/v0.1/"


def _torchvision(name: str, sha256: str) -> WeightsFile:
    return WeightsFile(name, sha256, TORCHVISION + name)


def _head(network: str, sha256: str) -> WeightsFile:
    return WeightsFile(f"lin_v0.1_{network}.pth", sha256, f"{HEADS}{network}.pth")


# The feature layers alone serve as well as torchvision's whole file, which is mostly classifier.
FEATURES: dict[Network, tuple[WeightsFile, ...]] = {
    "alex": (
        _torchvision("alexnet-owt-7be5be79.pth", "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02"),
        WeightsFile("alexnet_features.pth", "d1984d8953686263ce12843b6bcaf981532b38b6d64e815c97ee05e080b6a02c"),
    ),
    "squeeze": (
        _torchvision("squeezenet1_1-b8a52dc0.pth", "b8a52dc049b60e4b6ab68ad0df457362afab8b6304b2febdc1650a5dab4d7e7b"),
        WeightsFile("squeezenet1_1_features.pth", "435cedb387e95bc8291893f61a3a64f0345b8c23a05139aceef43947efb3d52d"),
    ),
    "vgg": (_torchvision("vgg16-397923af.pth", "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0"),),
}
LINEAR: dict[Network, WeightsFile] = {
    "alex": _head("alex", "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"),
    "squeeze": _head("squeeze", "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76"),
    "vgg": _head("vgg", "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868"),
}


class NotAvailable(Exception):  # noqa: N818, it is no error: the metric is left out, and the message says why
    """The weights are not here and could not be had."""


@dataclass(frozen=True)
class Perceptual:
    """LPIPS by each network that could be had, and why the others could not."""

    loaded: dict[Network, LearnedPerceptualSimilarity]
    missing: dict[Network, str]

    def for_size(self, width: int, height: int) -> Perceptual:
        """Without the networks that cannot take images of that size."""
        small = {n: lpips.smallest for n, lpips in self.loaded.items() if min(width, height) < lpips.smallest}
        why = {n: f"it takes no image under {side} pixels a side" for n, side in small.items()}
        return Perceptual({n: lpips for n, lpips in self.loaded.items() if n not in small}, self.missing | why)


def obtain(networks: tuple[Network, ...] | None, progress: Progress = lambda _done, _total: None) -> Perceptual:
    """LPIPS by the named networks, their weights downloaded where absent; None for AlexNet's, if it is at hand.

    Raises:
        InputError: `AA4D_WEIGHTS` names no folder, or a file is not the genuine one.
    """
    loaded: dict[Network, LearnedPerceptualSimilarity] = {}
    missing: dict[Network, str] = {}
    for network in networks or ("alex",):
        try:
            loaded[network] = load_lpips(network, download=networks is not None, progress=progress)
        except NotAvailable as reason:
            missing[network] = str(reason)
    return Perceptual(loaded, missing)


def load_lpips(network: Network, *, download: bool, progress: Progress) -> LearnedPerceptualSimilarity:
    """LPIPS by `network`, from files in the folders of `folders()`.

    Args:
        download: fetch what is missing into the first of these folders.

    Raises:
        InputError: `AA4D_WEIGHTS` names no folder, or a file there is not the genuine one.
        NotAvailable: a file is in none of the folders, and was not or could not be downloaded.
    """
    features = _obtain(FEATURES[network], download, progress)
    heads = _obtain((LINEAR[network],), download, progress)
    try:
        return LearnedPerceptualSimilarity(network, _read(features), _read(heads))
    except (KeyError, RuntimeError) as error:
        raise InputError(f"{features}: does not hold the layers of {network} ({error}); delete it") from None


def folders() -> list[Path]:
    """Folders in which weights are looked for: `AA4D_WEIGHTS` alone if set, else the cache of aa4d and of torch.hub.

    Raises:
        InputError: `AA4D_WEIGHTS` is set and no folder.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if not Path(named).is_dir():
            raise InputError(f"{named}: is no folder, but {VARIABLE} says that weights are there; make it or unset it")
        return [Path(named)]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return [cache / "aa4d", Path(torch.hub.get_dir()) / "checkpoints"]


def _obtain(candidates: tuple[WeightsFile, ...], download: bool, progress: Progress) -> Path:
    searched = folders()
    for file in candidates:
        for folder in searched:
            path = folder / file.name
            if path.is_file():
                _check(path, file)
                return path
    wanted = candidates[0]
    if not download or wanted.url is None:
        where = " and ".join(str(folder) for folder in searched)
        how = f"copy it there, or set {VARIABLE} to its folder"
        if wanted.url is not None:
            how = f"`aa4d eval --lpips` downloads it, or set {VARIABLE} to its folder"
        raise NotAvailable(f"{wanted.name} is not in {where}; {how}")
    try:
        make_folder(searched[0])
    except InputError:
        raise NotAvailable(f"{wanted.name} is not here, and {searched[0]} cannot be written to") from None
    return _download(wanted, wanted.url, searched[0] / wanted.name, progress)


def _download(file: WeightsFile, url: str, path: Path, progress: Progress) -> Path:
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as response, whole_file(path) as temporary:
            total, done = int(response.headers.get("Content-Length") or 0), 0
            with temporary.open("wb") as target:
                while chunk := response.read(CHUNK):
                    target.write(chunk)
                    done += len(chunk)
                    progress(done, max(total, done))
            # Before it gets its name: a download that was cut or exchanged leaves nothing behind.
            _check(temporary, file, "what came from " + url)
    except (urllib.error.URLError, OSError, http.client.HTTPException, ValueError) as error:
        reason = getattr(error, "reason", error)
        raise NotAvailable(f"{file.name} is not here and could not be downloaded ({reason})") from None
    return path


def _check(path: Path, file: WeightsFile, what: str | None = None) -> None:
    digest = hashlib.sha256()
    with path.open("rb") as source:
        while chunk := source.read(CHUNK):
            digest.update(chunk)
    if digest.hexdigest() != file.sha256:
        raise InputError(
            f"{what or path}: is not the genuine {file.name} (SHA-256 {digest.hexdigest()[:12]}..., "
            f"expected {file.sha256[:12]}...); delete it and let aa4d download it, or copy it again"
        )


def _read(path: Path) -> dict[str, Tensor]:
    state = torch.load(path, map_location="cpu", weights_only=True)
    if not isinstance(state, dict):
        raise InputError(f"{path}: holds no state of a network; delete it")
    return state
