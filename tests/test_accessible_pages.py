"""Pages and the manual in a browser: axe finds nothing that keeps somebody from reading them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.page import TrackedPage
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.result import Result

REPOSITORY = Path(__file__).parents[1]
SIZE = (640, 480)
# The theme's own: its switch of colours hides a button by `aria-hidden`, it names each code's buttons alike, and wide
# tables of the reference scroll by the pointer alone.
THEME = frozenset({"aria-hidden-focus", "landmark-unique", "scrollable-region-focusable"})
MANUAL = ("index", "how-to/count", "methods/flow", "results/index", "reference/people")


def violations(browser: Any, page: Path, scheme: str, width: int, ignored: frozenset[str] = frozenset()) -> list[str]:
    """The rules that a page breaks, but those ``ignored``, each with the first element that does."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    opened = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    opened.goto(page.as_uri())
    broken = axe.run(opened).response["violations"]
    opened.close()
    return [f"{rule['id']}: {rule['nodes'][0]['html']}" for rule in broken if rule["id"] not in ignored]


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 1280), ("light", 390), ("dark", 390)])
def test_the_page_of_a_result_is_accessible(tmp_path: Path, browser: Any, scheme: str, width: int) -> None:
    tracks = [walker(down(60 + 30 * k, range(60 + 5 * k, 350, 10)), k + 1) for k in range(4)]
    zone = SceneZone("shop", np.array([[0.0, 100], [200, 100], [200, 300], [0, 300]]))
    scene = Scene([SceneLine("door", np.array([[0.0, 100.0], [200.0, 100.0]]))], [zone], SIZE)
    result = Result(tracks, "", 10.0, SIZE, seconds={"detect": 2.0})
    (tmp_path / "report.html").write_text(TrackedPage(result, count(result, scene)).html(tmp_path), encoding="utf-8")
    assert violations(browser, tmp_path / "report.html", scheme, width) == []


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The manual, built."""
    pytest.importorskip("mkdocs")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(out)]
    subprocess.run(command, cwd=REPOSITORY, check=True, timeout=600)
    return out


@pytest.mark.slow
def test_the_manual_is_accessible_and_listed(site: Path, browser: Any) -> None:
    listed = [line.partition("](")[2].rstrip(")") for line in (site / "llms.txt").read_text().splitlines()]
    listed = [name for name in listed if name]
    assert len(listed) > 60
    assert [name for name in listed if not (site / name).is_file()] == []
    for name in MANUAL:
        for scheme in ("light", "dark"):
            assert violations(browser, site / f"{name}.html", scheme, 1280, THEME) == [], (name, scheme)
