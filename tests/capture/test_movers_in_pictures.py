"""Masks of movers cover nothing in which no motion can be measured."""

import numpy as np

from aa4d.capture.movers import without_bare


def test_a_patch_of_sky_is_no_mover_and_a_car_is() -> None:
    generator = np.random.default_rng(0)
    picture = 200 + 30 * np.linspace(0, 1, 240)[:, None] + generator.normal(0, 0.7, (240, 320))
    picture[150:170, 100:140] = 90  # a car of one color, with windows
    picture[155:160, 105:135] = 30
    mask = np.zeros((240, 320), np.uint8)
    mask[20:60, 40:120] = 1
    mask[148:172, 98:142] = 1
    kept = without_bare(mask, picture.clip(0, 255).astype(np.uint8))
    assert not kept[:100].any()
    assert kept[148:172, 98:142].all()
    assert not without_bare(np.zeros_like(mask), picture.astype(np.uint8)).any()
