"""Random generators by name: adding one never changes what another draws."""

import zlib

import numpy as np


def generator(seed: int, name: str) -> np.random.Generator:
    """The generator of the stream `name` under a scene's seed."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def frame_seed(seed: int, rank: int) -> int:
    """Seed of the renderer's sampling pattern for one frame: differs between frames, fits Cycles' 31 bits."""
    return (seed * 1_000_003 + rank * 7919 + 1) % (2**31 - 1)
