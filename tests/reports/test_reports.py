"""Reports of runs, experiments and comparisons: what they are told apart by, what they show, what they refuse."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.experiments.comparison_tables import Comparison, Failure, write_comparison
from aa4d.experiments.kinds.evaluate import Row, numbers
from aa4d.experiments.tables import write_tables
from aa4d.experiments.variants import Experiment, Variant
from aa4d.reports.frames import Drawn, worst_patches
from aa4d.reports.report import NAME, closing_line, write_report
from aa4d.reports.scored import Captures, ScoredRun, scored_run
from tests.browser import launched, watched
from tests.toy_capture import HEIGHT, WIDTH
from tests.toy_run import silent

SCRIPT = "<script>window.stolen = 1</script>".replace("/", "\u2044")  # as a folder may be called


@pytest.fixture(scope="module")
def scored(toy_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was scored; its capture lies where it was trained on. Not to be changed."""
    folder = tmp_path_factory.mktemp("scored") / "run"
    shutil.copytree(toy_run, folder)
    evaluate(folder, toy_run.parent / "capture", silent)
    return folder


@pytest.fixture
def run(scored: Path, tmp_path: Path) -> Path:
    """One that may be damaged."""
    return Path(shutil.copytree(scored, tmp_path / "run"))


def rows_in(folder: Path, scored: Path, variants: tuple[str, ...], seeds: tuple[int, ...] = (0,)) -> list[Row]:
    """Rows of runs that are copies of one, each with other scores, in the folders of an experiment."""
    rows = []
    for seed in seeds:
        for number, variant in enumerate(variants):
            out = folder / "capture" / variant.replace(" ", "-") / f"seed{seed}"
            shutil.copytree(scored, out)
            metrics = json.loads((out / "metrics.json").read_text())
            row: Row = {"capture": "capture", "variant": variant, "seed": seed, **numbers(metrics)}
            rows.append(row | {"psnr": 20.0 + number + seed / 10})
    return rows


@pytest.fixture
def ablation(scored: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "ablation"
    rows = rows_in(folder, scored, ("product", "ACFA"), (0, 1))
    (folder / "experiment.json").write_text(json.dumps({"experiment": "modules", "training": {"loss": {"dssim": 0.2}}}))
    write_tables(Experiment("modules", "What each module adds", (Variant("product"), Variant("ACFA"))), rows, folder)
    return folder


@pytest.fixture
def comparison(scored: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "comparison"
    titles = {"fourdgs": f"4D-GS {SCRIPT}", "adaanchor4d": "AdaAnchor4D", "adaanchor4d+tracks": "AdaAnchor4D + tracks"}
    rows = rows_in(folder, scored, tuple(titles))
    rows = [row | {"processor_minutes": 2.0 + n} for n, row in enumerate(rows)]
    conditions = {
        "command": "aa4d compare", "preset": "quick", "coarse_iterations": 8, "fine_iterations": 9, "seeds": [0],
        "jobs": 1, "processors": 2, "threads": 1,
    }  # fmt: skip
    failures = (Failure("capture", "fourdgs", 1, f"diverged {SCRIPT}"),)
    write_comparison(Comparison(titles, conditions, rows, failures), folder, [])
    (folder / "experiment.json").write_text("{}")
    return folder


def test_a_run_shows_scores_frames_history_settings_and_identity(run: Path) -> None:
    written = write_report(run)
    html = written.path.read_text("utf-8")
    metrics = json.loads((run / "metrics.json").read_text())
    assert written.path == run / NAME
    assert written.megabytes == pytest.approx(written.path.stat().st_size / 1e6)
    assert written.notes == ()
    for text in ("AdaAnchor4D", f"{metrics['psnr']:.2f} dB", "20 + 20 iterations", "coarse stage", "settings.toml"):
        assert text in html
    capture = read_capture(Path(json.loads((run / "config.json").read_text())["capture"]))
    held_out = capture.of_split("test")
    assert len(re.findall(r'alt="truth, frame', html)) == len(held_out)
    assert capture.identity.digest() in html
    assert "PSNR of training views" in html
    assert "Where moving pixels are worst" in html
    # Every file that is linked to is there.
    links = re.findall(r'href="([^"]*)"', html)
    assert set(links) == {"settings.toml", "metrics.json", "history.csv"}
    assert all((run / link).is_file() for link in links)


def test_a_page_that_lies_elsewhere_links_to_nothing(run: Path, tmp_path: Path) -> None:
    written = write_report(run, tmp_path / "new" / "page.html")
    assert "href" not in written.path.read_text("utf-8")
    assert not (run / NAME).exists()


def test_without_its_capture_a_run_has_no_true_frames_and_says_so(run: Path, tmp_path: Path) -> None:
    config = json.loads((run / "config.json").read_text())
    real = Path(config["capture"])
    (run / "config.json").write_text(json.dumps(config | {"capture": str(tmp_path / "gone")}))
    written = write_report(run)
    html = written.path.read_text("utf-8")
    assert written.notes == (
        "The capture gone is not where it was: its true frames are left out (--captures says where it lies).",
    )
    assert written.notes[0] in html
    assert "truth, frame" not in html
    assert "coarse stage, frame" in html  # what there is to compare with
    moved = Path(shutil.copytree(real, tmp_path / "moved"))
    again = write_report(run, captures=[moved])
    assert again.notes == ()
    assert "truth, frame" in again.path.read_text("utf-8")


def test_another_capture_in_the_place_of_its_own_is_not_taken_for_it(run: Path, tmp_path: Path) -> None:
    config = json.loads((run / "config.json").read_text())
    other = Path(shutil.copytree(config["capture"], tmp_path / "other"))
    index = json.loads((other / "capture.json").read_text())
    (other / "capture.json").write_text(json.dumps(index | {"fps": 2 * index.get("fps", 24)}))
    (run / "config.json").write_text(json.dumps(config | {"capture": str(other)}))
    (note,) = write_report(run).notes
    assert "The capture other is not what it was" in note


def test_pictures_that_are_missing_are_left_out(run: Path) -> None:
    shutil.rmtree(run / "eval")
    written = write_report(run)
    html = written.path.read_text("utf-8")
    assert "<img" not in html
    assert "Every held-out frame" in html
    assert written.notes == ("2 of 2 held-out frames of run have no picture; aa4d eval draws them again.",)
    assert written.notes[0] in html


def damaged_picture(run: Path) -> None:
    (run / "eval" / "000000.png").write_bytes(b"\x89PNG\r\n\x1a\n")


def other_size(run: Path) -> None:
    Image.new("RGB", (3, 2)).save(run / "eval" / "000000.png")


def changed(**values: Any) -> Callable[[Path], None]:
    def damage(run: Path) -> None:
        path = run / "metrics.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | values))

    return damage


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda run: (run / "metrics.json").write_text("{"), "metrics.json: not readable as the scores of a run"),
        (lambda run: (run / "metrics.json").write_text("[]"), "expected the scores of a run, found a JSON list"),
        (changed(psnr="34"), "is damaged or of an older version (psnr is no number); run `aa4d eval"),
        (changed(frames=[]), "frames is no list of scores"),
        (changed(frames=[{"frame": "../../secret", "t": 0, "psnr": 1}]), "frames[0].frame is no name of a frame"),
        (changed(frames=[{"frame": "a", "t": 0, "psnr": None}]), "frames[0].psnr is no number"),
        (changed(lpips=3), "is damaged or of an older version"),
        (lambda run: (run / "metrics.json").unlink(), "run: has not been scored; run `aa4d eval"),
        (damaged_picture, "000000.png: cannot be read as a picture"),
        (other_size, "000000.png: has another size than the frame; run `aa4d eval"),
        (lambda run: (run / "history.csv").write_text("a,b\n1,2\n"), "history.csv: has no column 'step'"),
    ],
)
def test_a_damaged_run_is_one_sentence_and_leaves_nothing(run: Path, damage: Callable[[Path], None], says: str) -> None:
    damage(run)
    with pytest.raises(InputError, match=re.escape(says)):
        write_report(run)
    assert not (run / NAME).exists()


def test_what_has_no_report_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / "experiment.json").write_text("{}")
    for folder, says in (
        ("absent", "absent: no such folder; name a run, an experiment or a comparison"),
        ("empty", "empty: neither a run of `aa4d train` nor what"),
        ("begun", "begun: no run has been scored yet"),
    ):
        with pytest.raises(InputError, match=re.escape(says)):
            write_report(tmp_path / folder)
    with pytest.raises(InputError, match="is a file; name the folder that holds it"):
        write_report(Path(__file__))


def test_a_run_of_an_experiment_is_titled_as_in_its_tables(ablation: Path, run: Path) -> None:
    html = write_report(ablation / "capture" / "ACFA" / "seed0").path.read_text("utf-8")
    assert "<title>capture, ACFA, seed 0</title>" in html
    assert "<title>Run run</title>" in write_report(run).path.read_text("utf-8")


def test_the_page_of_a_run_says_why_lpips_is_missing_and_counts_one_as_one(run: Path) -> None:
    metrics = json.loads((run / "metrics.json").read_text())
    changed(lpips={}, lpips_not_measured={"vgg": "no weights at hand"}, threads=1, frames=metrics["frames"][:1])(run)
    html = write_report(run).path.read_text("utf-8")
    assert "LPIPS (vgg) not measured: no weights at hand" in html
    assert ", 1 thread<" in html
    assert "scored on 1 frame that training never saw" in html
    assert "Drag the divider" in html


def test_captures_that_are_not_there_are_refused_whether_or_not_they_are_looked_for(ablation: Path) -> None:
    shutil.rmtree(ablation / "capture")  # no run is left that would ask for its capture
    with pytest.raises(InputError, match="--captures nowhere: no such capture folder"):
        write_report(ablation, captures=[Path("nowhere")])


def test_what_cannot_be_written_is_refused(run: Path) -> None:
    with pytest.raises(InputError, match="--megabytes 0: must be a positive number"):
        write_report(run, megabytes=0)
    with pytest.raises(InputError, match=r"cannot be smaller than 0\.\d+ MB; give --megabytes 0\.\d+ or more"):
        write_report(run, megabytes=0.001)
    with pytest.raises(InputError, match="is a folder; name the file with --out"):
        write_report(run, run / "eval")
    scores = (run / "metrics.json").read_bytes()
    with pytest.raises(InputError, match=r"metrics\.json: is there and no page; name another file, .*metrics\.html"):
        write_report(run, run / "metrics.json")
    assert (run / "metrics.json").read_bytes() == scores


def large(run: Path) -> None:
    """Give the run's renders of held-out frames the size of a film's, and noise that is hard to compress."""
    random = np.random.default_rng(0)
    for path in (run / "eval").glob("0*.png"):
        Image.fromarray(random.integers(0, 255, (720, 1280, 3), dtype=np.uint8)).save(path)
    config = json.loads((run / "config.json").read_text())
    (run / "config.json").write_text(json.dumps(config | {"capture": "gone"}))


def test_pictures_shrink_until_the_file_is_small_enough_and_the_page_says_so(run: Path) -> None:
    large(run)
    whole, small = write_report(run, megabytes=100), write_report(run, run / "small.html", megabytes=1.5)
    assert whole.megabytes > 1.5 >= small.megabytes
    assert "To stay below" not in whole.path.read_text("utf-8")
    assert "To stay below 1.5 MB, pictures are" in small.path.read_text("utf-8")


def test_an_ablation_has_its_tables_by_the_variants_order(ablation: Path) -> None:
    html = write_report(ablation).path.read_text("utf-8")
    assert "What each module adds (paper" in html
    rows = re.findall(r"<tr><td>(product|ACFA)</td><td", html)
    assert rows == ["product", "ACFA", "ACFA"]  # the means, the difference
    assert "20.05 ±0.07" in html  # product: 20.0 and 20.1
    assert "+1.00 ±0.00" in html
    assert "loss.dssim" in html
    assert "PSNR of training views on capture" in html
    assert html.count('alt="ACFA, frame') == 2
    assert set(re.findall(r'href="([^"]*)"', html)) == {"table.md", "pooled.md", "rows.csv", "plot.png"}


def test_an_experiment_files_runs_are_found_where_the_graph_keeps_them(ablation: Path, scored: Path) -> None:
    shutil.rmtree(ablation / "capture")
    (ablation / "tables").mkdir()
    (ablation / "rows.csv").rename(ablation / "tables" / "rows.csv")
    (ablation / "experiment.toml").write_text('title = "Of one\'s own"\nscenes = ["capture"]\n')
    (ablation / "tables" / "failed.md").write_text("- capture, other, seed 0: it diverged\n")
    shutil.copytree(scored, ablation / "train" / "capture-product-seed-0-0123456789ab")
    evaluated = ablation / "evaluate" / "capture-product-seed-0-ba9876543210"
    shutil.copytree(scored, evaluated)
    (evaluated / "config.json").unlink()
    record = {
        "name": "capture, product, seed 0",
        "made_from": {"0123456789ab" + 52 * "0": ""},
        "result": {"psnr": 20.0},
    }
    evaluated.with_suffix(".json").write_text(json.dumps(record))
    html = write_report(ablation).path.read_text("utf-8")
    assert "<title>Of one&#39;s own</title>" in html
    assert "capture, other, seed 0: it diverged" in html
    assert html.count('alt="truth, frame') == 2  # by the capture in the training's config.json
    assert "PSNR of training views on capture" in html


def test_scores_stand_over_the_knob_that_an_experiment_turns(ablation: Path) -> None:
    (ablation / "tables").mkdir()
    (ablation / "experiment.toml").write_text('title = "Noise"\n[axis]\nlabel = "noise, cm"\nvalues = [1, 4]\n')
    rows = [f"s {at},{variant},0,{at},{psnr}" for variant, psnr in (("a", 30.0), ("b", 20.0)) for at in (1.0, 4.0)]
    (ablation / "tables" / "rows.csv").write_text("\n".join(["capture,variant,seed,at,psnr", *rows, ""]))
    html = write_report(ablation).path.read_text("utf-8")
    assert "Scores against the knob" in html
    assert "PSNR, dB over noise, cm of a, b" in html
    assert "<title>b: 4, 20</title>" in html


@pytest.mark.parametrize(
    "text",
    [
        "",
        "capture,variant\na,b\n",
        "capture,variant,seed,psnr\na,b,0,high\n",
        "capture,variant,seed,psnr,ssim\na,b,0,1,?\n",
    ],
)
def test_damaged_rows_are_refused(ablation: Path, text: str) -> None:
    (ablation / "rows.csv").write_text(text)
    with pytest.raises(InputError, match=r"rows\.csv: "):
        write_report(ablation)


def test_rows_that_name_folders_elsewhere_find_none(ablation: Path) -> None:
    rows = (ablation / "rows.csv").read_text()
    (ablation / "rows.csv").write_text(rows.replace("capture,product", "../ablation/capture,product"))
    html = write_report(ablation).path.read_text("utf-8")
    assert 'alt="product, frame' not in html


def test_a_comparison_marks_the_best_and_lists_failures(comparison: Path) -> None:
    html = write_report(comparison).path.read_text("utf-8")
    assert re.search(r'<td class="number best" data-value="22.0">22.00</td>', html)
    assert re.search(r'<td class="number second" data-value="21.0">21.00</td>', html)
    assert "seed 1: diverged &lt;script&gt;" in html
    assert "<script>window" not in html
    assert "PSNR against processor minutes" in html


def test_a_star_is_explained_where_there_is_one_and_what_is_missing_is_named(comparison: Path) -> None:
    path = comparison / "compare.json"
    star = "the star is what aa4d train does where nothing is said"
    html = write_report(comparison).path.read_text("utf-8")
    assert star in html
    assert "Of capture. Bars" in html
    assert "Unfinished" not in html
    document = json.loads(path.read_text())
    rows = [row for row in document["rows"] if row["variant"] != "adaanchor4d+tracks"]
    lacking = ["capture, adaanchor4d+tracks, seed 0"]
    path.write_text(json.dumps(document | {"rows": rows, "missing": lacking}))
    html = write_report(comparison).path.read_text("utf-8")
    assert star not in html
    assert "Unfinished: 1 of 4 runs missing: capture, adaanchor4d+tracks, seed 0." in html


@pytest.mark.parametrize(
    "text", ["{", "{}", '{"conditions": {}, "methods": {}, "rows": [{}], "failed": []}', '{"rows": 3, "methods": []}']
)
def test_a_damaged_comparison_is_refused(comparison: Path, text: str) -> None:
    (comparison / "compare.json").write_text(text)
    with pytest.raises(InputError, match=r"compare\.json: "):
        write_report(comparison)


def test_a_comparison_is_opened_sorted_and_slid_in_a_browser(comparison: Path) -> None:
    written = write_report(comparison)
    with launched() as browser, watched(browser, 1000, 800) as seen:
        page = seen.page
        page.set_default_timeout(120_000)
        page.goto(written.path.as_uri())
        table = page.locator("table").first
        first = table.locator("tbody tr td:first-child")
        assert first.all_inner_texts()[0].startswith("4D-GS <script>")
        table.get_by_role("button", name=re.compile(r"^PSNR\s↑$")).click()
        assert first.all_inner_texts()[0] == "AdaAnchor4D + tracks"
        assert page.locator(".tag.left:visible").first.inner_text() == "AdaAnchor4D"  # method against method
        slider = page.get_by_role("slider").first
        slider.focus()
        page.keyboard.press("ArrowLeft")
        assert slider.input_value() == "490"
        assert page.evaluate("window.stolen === undefined")
        assert (seen.errors, seen.requests) == ([], [])


def test_at_the_end_of_a_command_a_page_of_the_same_is_kept_and_trouble_is_told(ablation: Path) -> None:
    assert re.fullmatch(r"report: .*report\.html \(\d\.\d MB\)", closing_line(ablation))
    page = ablation / NAME
    before = page.stat().st_mtime_ns
    assert "report.html" in closing_line(ablation)
    assert page.stat().st_mtime_ns == before
    rows = (ablation / "rows.csv").read_text()
    (ablation / "rows.csv").write_text(rows.replace("20.1", "20.2"))
    closing_line(ablation)
    assert page.stat().st_mtime_ns > before
    (ablation / "rows.csv").write_text("")
    assert closing_line(ablation).startswith("report: not written: ")


def test_the_worst_drawn_mover_is_found_in_closed_form(run: Path) -> None:
    """The square is drawn well in one held-out frame and black in the other."""
    loaded = scored_run(run)
    capture = Captures().of(loaded)
    assert capture is not None
    for index in capture.of_split("test"):
        frame = capture.frames[index]
        picture = np.asarray(Image.open(capture.folder / frame.image).convert("RGB")).astype(int)
        off = 51 if frame.name == "000008" else 5  # a fifth of the range: 13.98 dB
        drawn = np.where(picture >= off, picture - off, picture + off).astype(np.uint8)
        Image.fromarray(drawn).save(run / "eval" / f"{frame.name}.png")
    names = [capture.frames[i].name for i in capture.of_split("test")]
    worse, *_ = worst_patches(capture, [Drawn("render", loaded)], names, 5)
    assert worse.frame == "000008"
    assert worse.psnr[0] == pytest.approx(13.979, abs=0.01)
    left, top, right, bottom = worse.window
    assert 0 <= left < right <= WIDTH
    assert 0 <= top < bottom <= HEIGHT


def test_scores_without_identity_are_taken_as_they_are(run: Path) -> None:
    """As those of an older version."""
    loaded = scored_run(run)
    old = ScoredRun(run, run, {k: v for k, v in loaded.metrics.items() if k != "identity"})
    assert old.digest != loaded.digest
    assert old.digest != replace(old, metrics=old.metrics | {"psnr": 1.0}).digest
