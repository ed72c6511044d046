"""docs/settings.md says what the declarations say."""

from pathlib import Path

from aa4d.settings.page import page


def test_the_page_is_current() -> None:
    file = Path(__file__).parents[2] / "docs/settings.md"
    assert file.read_text(encoding="utf-8") == page(), "run `python -m aa4d.settings.page > docs/settings.md`"


def test_a_setting_has_its_values_its_range_its_meaning_and_its_source() -> None:
    for title in ("## Training: `adaanchor4d`", "## Training: `fourdgs`", "## Capture"):
        assert title in page().splitlines()
    row = "| `dssim` | 0.2 | a number from 0 to 1 | D-SSIM; L1 has the rest | Scaffold-GS |"
    assert row in page().splitlines()
    assert "| `coarse_iterations` | 800 / 1500 / 3000 | " in page()
