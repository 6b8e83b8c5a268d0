"""Shared fixtures: where the real data is, and small inputs that many tests need."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking import cli
from tsuiseki.tracking.cli.commands import all_commands
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.formats.okutama import actions_of, write_okutama
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth

REPOSITORY = Path(__file__).resolve().parent.parent
# The marks of `make test`, of `make test-slow`, and of both at once.
QUICK, SLOW, ALL = "not gpu and not slow and not browser", "slow and not paced and not gpu and not browser", ""
# Commands that ended well, in this process and in those of pytest-xdist.
RAN: set[str] = set()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real data; skips the test where there is none."""
    folder = Path(os.environ.get("TSUISEKI_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}; set TSUISEKI_DATA to the folder that holds mot/, sot/, ...")
    return folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """The system's Chromium, driven by playwright; skips the test where either is missing."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright; install the extra dev")
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("no Chromium on this computer; install the system's package chromium")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def labelled_square(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An OTB folder of a bright square on noise."""
    folder = tmp_path_factory.mktemp("otb") / "Square"
    (folder / "img").mkdir(parents=True)
    rows = []
    noise = np.random.default_rng(0).integers(0, 90, (100, 140, 3), dtype=np.uint8)
    for t in range(8):
        image = noise.copy()
        cv2.rectangle(image, (20 + 3 * t, 30), (49 + 3 * t, 64), (40, 200, 240), -1)
        cv2.circle(image, (35 + 3 * t, 45), 8, (200, 30, 30), -1)
        cv2.imwrite(str(folder / "img" / f"{t + 1:04d}.png"), image)
        rows.append(f"{21 + 3 * t},31,30,35")
    (folder / "groundtruth_rect.txt").write_text("\n".join(rows) + "\n")
    return folder


@pytest.fixture(scope="session")
def acting_clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``train/train-{0,1}`` and ``validation/validation-0``: coloured boxes that walk, run or sit.

    The clip of ``okutama`` is that of ``validation`` in Okutama-Action's own layout.
    """
    folder = tmp_path_factory.mktemp("acting")
    for seed, name in enumerate(("train-0", "train-1", "validation-0")):
        _write_acting_clip(folder / name.split("-")[0] / name, seed)
    clip, layout = folder / "validation/validation-0", folder / "okutama"
    labels = layout / "Labels/SingleActionTrackingLabels/3840x2160/1.1.1.txt"
    frames = layout / "Drone1/Morning/Extracted-Frames-1280x720/1.1.1"
    for place in (labels.parent, frames):
        place.mkdir(parents=True)
    labels.symlink_to(clip / "gt/actions.txt")
    for number, image in enumerate(sorted((clip / "img1").iterdir())):
        (frames / f"{number}.jpg").symlink_to(image)
    return folder


def _write_acting_clip(folder: Path, seed: int, frames: int = 22, people: int = 5) -> None:
    """Red boxes walk 3 pixels a frame, blue ones run 5, green ones sit; one is hidden in one frame."""
    names, colours, speeds = ("Walking", "Sitting", "Running"), ((0, 0, 220), (0, 200, 0), (220, 0, 0)), (3, 0, 5)
    rng = np.random.default_rng(seed)
    height, width = 180, 320
    ground = cv2.GaussianBlur(rng.integers(0, 255, (height, width, 3)).astype(np.uint8), (0, 0), 2)
    does = np.array([0, 0, 1, 1, 2])
    x = 20 + 10 * rng.random(people)
    rows = []
    (folder / "img1").mkdir(parents=True)
    for frame in range(frames):
        image = ground.copy()
        for k in range(people):
            left, top = int(x[k] + speeds[does[k]] * frame), 4 + 30 * k
            image[top : top + 24, left : left + 14] = colours[does[k]]
            image[top + 2 : top + 22 : 5, left + 2 : left + 12] = 60
            rows.append((frame, k + 1, left, top, left + 14, top + 24, frame == 4 and k == 0))
        cv2.imwrite(str(folder / "img1" / f"{frame + 1:06d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    table = np.array(rows, dtype=np.float64)
    at, ids, boxes, hidden = table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:6], table[:, 6] > 0
    none = np.zeros(len(table), dtype=np.bool_)
    actions = actions_of([(names[does[k - 1]],) for k in ids.tolist()])
    labels = ActionLabels(at, ids, boxes, none, hidden, none, actions, OKUTAMA_ACTIONS)
    write_okutama(folder / "gt/actions.txt", labels, (width, height))
    write_ground_truth(folder / "gt/gt.txt", GroundTruth(at, ids, boxes, ~none, none, np.ones(len(table))))
    write_sequence_info(folder, folder.name, 30.0, frames, width, height)


def pytest_configure() -> None:
    """In the background, and under `nohup`, such signals are ignored, and tests that send one would fail."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL, signal.SIGTERM: signal.SIG_DFL}
    for number, handler in usual.items():
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    cli._run = noted(cli._run)


def noted(run: Callable[[list[str]], int]) -> Callable[[list[str]], int]:
    """``run``, which puts the commands that end well into `RAN`."""

    def noting(words: list[str]) -> int:
        status = run(words)
        RAN.update([" ".join(words[:2]), *words[:1]] if status == 0 and "--help" not in words else ())
        return status

    return noting


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """What a process of pytest-xdist ran."""
    RAN.update(getattr(node, "workeroutput", {}).get("commands", ()))


def never_run(ran: Collection[str]) -> list[str]:
    """Commands that are not among ``ran``."""
    return [name for name in map(" ".join, all_commands()) if name not in ran]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever asks for the real data is an integration test, whatever asks for a browser one in a browser."""
    marks = {"data_folder": pytest.mark.integration, "browser": pytest.mark.browser}
    for item in items:
        for name in marks.keys() & set(getattr(item, "fixturenames", ())):
            item.add_marker(marks[name])


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """`make test-slow`, after `make test`, fails where a command ended well in neither.

    On CI both fail where real data was there and not used.
    """
    config = session.config
    if hasattr(config, "workeroutput"):
        config.workeroutput["commands"] = sorted(RAN)
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or config.args_source.name == "ARGS" or config.option.collectonly:
        return
    marks, passed_all = config.option.markexpr, exitstatus == pytest.ExitCode.OK
    whole = passed_all and not config.option.keyword and not config.option.deselect
    if whole and marks == QUICK:
        config.cache.set("tsuiseki/commands", sorted(RAN))
    before = config.cache.get("tsuiseki/commands", []) if marks == SLOW else []
    if whole and (before or marks == ALL) and (missing := never_run({*RAN, *before})):
        reporter.write_line(f"no test runs these commands with good input: {', '.join(missing)}", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
    folder = Path(os.environ.get("TSUISEKI_DATA", REPOSITORY.parent / "shared" / "data"))
    if not os.environ.get("CI") or not folder.is_dir():
        return
    skipped = [r.nodeid for r in reporter.stats.get("skipped", []) if "integration" in r.keywords]
    passed = [r.nodeid for r in reporter.stats.get("passed", []) if "integration" in r.keywords]
    if skipped or not passed:
        reporter.write_line(
            f"real data is at {folder}, but integration tests did not run: {skipped or 'none found'}", red=True
        )
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
