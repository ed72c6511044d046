"""Grid4D's grids and deformation against their formulas in loops; what its penalty draws; files it refuses."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file

from aa4d.capture.frame import frame_of
from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.gaussians.model import blank_rows
from aa4d.methods.grid4d.hash_grid import HashGrid, level_sizes, rows_of
from aa4d.methods.grid4d.method import METHOD
from aa4d.methods.grid4d.model import Grid4D
from aa4d.methods.grid4d.settings import PRESETS, ModelConfig
from aa4d.methods.model_file import load_model, read_tensors, save_model
from tests.methods.formulas import changed, linear, relu, sigmoid

SMALL = ModelConfig(
    table=6, place_levels=2, place_coarsest=3, place_finest=8, time_levels=2, time_coarsest=3, time_finest=6,
    instants=4, width=5,
)  # fmt: skip


def random_model(config: ModelConfig = SMALL, n: int = 5) -> Grid4D:
    torch.manual_seed(0)
    model = Grid4D(config, blank_rows(n)).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
        model.box.copy_(torch.tensor([[-2.0, -1, -3], [1, 2, 0.5]]))
    return model


def features(grid: HashGrid, x: list[float]) -> list[float]:
    """Of each level, by the eight vertices around x."""
    found: list[float] = []
    for size, table in zip(grid.sizes, grid.levels, strict=True):
        place = [min(max(v, 0), 1) * (n - 1) for v, n in zip(x, size, strict=True)]
        low = [min(math.floor(p), n - 2) for p, n in zip(place, size, strict=True)]
        total = [0.0] * table.shape[1]
        for corner in range(8):
            bits = [corner >> axis & 1 for axis in range(3)]
            i, j, k = (a + b for a, b in zip(low, bits, strict=True))
            share = math.prod(p - a if bit else 1 - (p - a) for p, a, bit in zip(place, low, bits, strict=True))
            if math.prod(size) <= 2**grid.table:
                row = i + size[0] * (j + size[1] * k)
            else:
                row = (i ^ j * 2654435761 ^ k * 805459861) % 2**grid.table
            total = [t + share * v for t, v in zip(total, table[row].tolist(), strict=True)]
        found += total
    return found


def rotate(q: list[float], x: list[float]) -> list[float]:
    """By the matrix of q / |q|."""
    w, a, b, c = (v / math.sqrt(sum(u * u for u in q)) for v in q)
    rows = [
        [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
        [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
        [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
    ]
    return [sum(m * v for m, v in zip(row, x, strict=True)) for row in rows]


def test_levels_grow_by_equal_factors_along_each_axis() -> None:
    assert level_sizes((16, 16, 16), (256, 256, 64), 3) == [(16, 16, 16), (64, 64, 32), (256, 256, 64)]
    assert level_sizes((4, 4, 2), (9, 9, 9), 1) == [(4, 4, 2)]
    assert level_sizes((16,) * 3, (2048,) * 3, 16)[-1] == (2048,) * 3


@pytest.mark.parametrize("table", [5, 9], ids=["hashed", "a row for each vertex"])
def test_features_agree_with_the_formula_number_by_number(table: int) -> None:
    torch.manual_seed(3)
    grid = HashGrid([(3, 4, 2), (8, 7, 5)], table, features=3).double()
    for level in grid.levels:
        torch.nn.init.normal_(level)
    assert [len(level) for level in grid.levels] == [24, min(280, 2**table)]
    x = torch.rand(40, 3, dtype=torch.float64)
    x[:4] = torch.tensor([[0.0, 0, 0], [1, 1, 1], [-0.3, 0.5, 2], [1, 0, 0.25]])
    got = grid(x)
    for row, place in zip(got.tolist(), x.tolist(), strict=True):
        assert row == pytest.approx(features(grid, place), abs=1e-12)


def test_tables_learn_by_finite_differences_and_places_do_not() -> None:
    torch.manual_seed(3)
    grid = HashGrid([(3, 4, 2), (8, 7, 5)], 5, features=2).double()
    x = torch.rand(9, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda *_: grid(x.detach()), tuple(grid.levels))
    grid(x).sum().backward()
    assert x.grad is None


@pytest.mark.parametrize("far", [math.inf, -math.inf, math.nan, 3e38, -3e38])
def test_features_far_outside_are_those_of_the_border(far: float) -> None:
    grid = HashGrid([(3, 3, 3), (60, 60, 60)], 4, features=2)
    border = 1.0 if far > 0 else 0.0
    assert torch.equal(grid(torch.tensor([[far, 0.3, 0.7]])), grid(torch.tensor([[border, 0.3, 0.7]])))


def test_the_finest_hash_needs_no_more_than_64_bits() -> None:
    last = 2**16 - 1
    grid = HashGrid([(2**16,) * 3], 19, features=1).double()
    torch.nn.init.normal_(grid.levels[0])
    assert grid(torch.ones(1, 3, dtype=torch.float64)).item() == pytest.approx(features(grid, [1.0] * 3)[0], abs=1e-9)
    assert (last * 2654435761) < 2**63


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_the_deformation_agrees_with_the_formulas_number_by_number(depth: int) -> None:
    model, t = random_model(replace(SMALL, depth=depth)), 0.3
    rows = model.free.rows()
    with torch.no_grad():
        after = model.deformed(rows, t)
    low, high = model.box.tolist()
    for n in range(len(model)):
        position, quaternion = rows.position[n].tolist(), rows.quaternion[n].tolist()
        place = [(v - a) / (b - a) for v, a, b in zip(position, low, high, strict=True)]
        clip = 0.05 + 0.9 * t
        asked = ([place[0], place[1], clip], [place[1], place[2], clip], [place[0], place[2], clip])
        of_time = [v for grid, x in zip(model.time_grids, asked, strict=True) for v in features(grid, x)]
        attention = [2 * sigmoid(v) - 1 for v in linear(model.attention, features(model.place_grid, place))]
        h = [a * b for a, b in zip(relu(linear(model.dynamics, of_time)), attention, strict=True)]
        for layer in model.layers:
            h = relu(linear(layer, h))
        motion, turn, growth = (linear(x, h) for x in (model.head_motion, model.head_quaternion, model.head_scale))
        moved = rotate([motion[0] + 1, *motion[1:4]], position)
        expected = {"position": [a + b for a, b in zip(moved, motion[4:], strict=True)]}
        expected |= changed(quaternion, rows.log_scale[n].tolist(), turn, growth)
        for name, values in expected.items():
            assert getattr(after, name)[n].tolist() == pytest.approx(values, rel=1e-9, abs=1e-9), name
    for name in ("opacity", "sh_constant", "sh_rest"):
        assert torch.equal(getattr(after, name), getattr(rows, name))


def test_gradients_are_those_of_finite_differences() -> None:
    model = random_model(n=2)

    def moved(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        after = model.deformed(model.free.rows(), 0.4)
        return after.position, after.log_scale, after.quaternion

    learned = [p for p in model.parameters() if p is not model.free.position]
    owned = ("opacity", "sh_constant", "sh_rest")
    learned = [p for p in learned if not any(p is getattr(model.free, name) for name in owned)]
    assert torch.autograd.gradcheck(moved, tuple(learned), fast_mode=True)


def test_a_still_start_changes_nothing_but_the_quaternions_length() -> None:
    torch.manual_seed(1)
    model = Grid4D(replace(SMALL, still_start=True), replace(blank_rows(4), position=torch.randn(4, 3)))
    torch.nn.init.normal_(model.free.quaternion)
    with torch.no_grad():
        rows = model.free.rows()
        after = model.deformed(rows, 0.8)
    assert torch.equal(after.position, rows.position)
    assert torch.allclose(after.quaternion, torch.nn.functional.normalize(rows.quaternion, dim=1))


def test_the_penalty_is_that_of_the_iteration_and_nothing_in_a_static_stage() -> None:
    """Killed and continued, a training draws the same."""
    model, settings = random_model(n=40), replace(PRESETS["quick"], model=SMALL)
    fine = METHOD.stages(settings)[1]
    with torch.no_grad():
        model.free.position.uniform_(-1, 0.5)
    found = []
    for iteration in (3, 4, 3):
        METHOD.begin_step(fine, iteration, model, settings)
        penalty = METHOD.penalty(fine, model, settings)
        assert penalty is not None
        found.append(float(penalty.detach()))
    assert found[0] == found[2] != found[1]
    assert found[0] > 0
    assert METHOD.penalty(replace(fine, canonical=True), model, settings) is None
    off = replace(settings, loss=replace(settings.loss, place=0.0, time=0.0))
    assert METHOD.penalty(fine, model, off) is None
    still = replace(settings, loss=replace(settings.loss, nearby=0.0))
    nothing = METHOD.penalty(fine, model, still)
    assert nothing is not None
    assert float(nothing.detach()) == 0


def test_every_parameter_learns_in_one_group() -> None:
    model = random_model()
    grouped = [id(p) for parameters in model.parameter_groups(canonical=False).values() for p in parameters]
    assert sorted(grouped) == sorted(id(p) for p in model.parameters())


def write(path: Path, folder: Path) -> tuple[Path, Grid4D]:
    model, capture = random_model().float(), read_capture(folder)
    frame, background, training = frame_of(capture), (0.1, 0.2, 0.3), {"seconds": 1.0}
    save_model(
        path, "grid4d", model, is_static=False, capture=capture, frame=frame, background=background, training=training
    )
    return path, model


def test_a_file_is_read_back_whole(toy_capture: Path, tmp_path: Path) -> None:
    path, model = write(tmp_path / "model.safetensors", toy_capture)
    loaded = load_model(path).model
    assert loaded.state_dict().keys() == model.state_dict().keys()
    assert all(torch.equal(value, loaded.state_dict()[name]) for name, value in model.state_dict().items())
    with torch.no_grad():
        assert torch.equal(loaded.centers(0.6), model.centers(0.6))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c, _: c.update(table=23), "config: table: .*23"),
        (lambda c, _: c.update(width=True), "config: width"),
        (lambda c, _: c.update(time_levels=1e999), "config: time_levels"),
        (lambda c, _: c.pop("depth"), "it lacks depth"),
        # Gigabytes, were the tables made before the file was looked at.
        (lambda c, _: c.update(table=22, place_finest=65_536, place_levels=32), "place_grid.levels.1 is "),
        (lambda _, t: t.pop("time_grids.2.levels.1"), "'time_grids.2.levels.1' is missing"),
        (lambda _, t: t.update({"time_grids.0.levels.0": torch.zeros(3, 2)}), r"levels.0 is \(3, 2\), expected"),
    ],
)
def test_what_no_training_wrote_is_refused_in_one_sentence(
    change: Callable[[dict[str, Any], dict[str, torch.Tensor]], Any], says: str, toy_capture: Path, tmp_path: Path
) -> None:
    path, _ = write(tmp_path / "model.safetensors", toy_capture)
    header, tensors = read_tensors(path)
    change(header["config"], tensors)
    save_file(tensors, str(path), metadata={"aa4d": json.dumps(header)})
    with pytest.raises(InputError, match=says) as refused:
        load_model(path)
    assert "\n" not in str(refused.value)


def test_a_level_has_no_more_rows_than_its_table() -> None:
    assert rows_of((3, 4, 2), 5) == 24
    assert rows_of((300, 300, 300), 19) == 2**19
