"""What a batch takes: folders, globs, manifests and addresses; and what it refuses before anything is done."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import tsuiseki
from tsuiseki.tracking.batch.jobs import Job
from tsuiseki.tracking.batch.sources import jobs_of
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError

PEOPLE = ["batch", "track", "people"]
SORT = Job(("track", "people"), "", "", {"method": "sort"})


def named(*sources: str | Path) -> dict[str, str]:
    return {job.name: job.source for job in jobs_of([str(source) for source in sources], SORT)}


def test_folders_globs_and_files(videos: Path, tmp_path: Path) -> None:
    (tmp_path / "day/morning").mkdir(parents=True)
    for name in ("day/a.mp4", "day/morning/b.avi", "day/notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    assert list(named(tmp_path)) == ["day-a", "day-morning-b"]
    assert list(named(videos)) == ["coded", "pictures", "still", "uneven", "web"]
    assert list(named(videos / "*.mp4", videos / "pictures")) == ["coded", "uneven", "pictures"]
    assert list(named(tmp_path / "**/b.*")) == ["b"]


@pytest.mark.slow
def test_manifests(videos: Path, tmp_path: Path) -> None:
    table = tmp_path / "list.csv"
    table.write_text(f"source,name,frames,view,overlay\n{videos}/web.webm,first,2-9,2,\n{videos}/web.webm,,,,true\n")
    first, second = jobs_of([str(table)], SORT)
    assert (first.name, second.name) == ("first", "web")
    given = first.request(first.source, tmp_path).arguments.arguments
    assert (given["video"].frames, given["finding"].view, given["linking"].method) == ("2-9", "2", "sort")
    assert second.request(second.source, tmp_path).arguments.arguments["video"].overlay
    lines = tmp_path / "list.yaml"
    lines.write_text(f"- source: {videos}/web.webm\n  method: ocsort\n  ocsort: {{max_age: 7}}\n")
    (job,) = jobs_of([str(lines)], SORT)
    linking = job.request(job.source, tmp_path).arguments.arguments["linking"]
    assert (linking.method, linking.ocsort.max_age) == ("ocsort", 7)


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ("source,framez\n{0},1-2\n", "list.csv row 1: unknown option --framez; did you mean --frames?"),
        ("source,fps\n{0},quick\n", "list.csv row 1: "),
        ("source,name\n{0},a\n{0},A\n", "row 1 and .*row 2 would both be called A"),
        ("video\n{0}\n", "row 1: expected a `source`, got video"),
        ("source\nmissing.mp4\n", "row 1: there is no missing.mp4"),
        ("source,name\n{0},../up\n", "expected a name for a folder"),
        ("", "expected rows with a `source`"),
    ],
)
def test_wrong_manifests_name_the_row(videos: Path, tmp_path: Path, rows: str, why: str) -> None:
    (tmp_path / "list.csv").write_text(rows.format(videos / "web.webm"))
    with pytest.raises(RequestError, match=why):
        jobs_of([str(tmp_path / "list.csv")], SORT)


@pytest.mark.parametrize(
    ("sources", "why"),
    [
        (["none/*.mp4"], "no file fits this pattern"),
        (["none.mp4"], "there is no such file or folder"),
        ([""], "expected a value, got an empty one"),
        (["nosuch://there/x.mp4"], "nothing here reads nosuch://"),
        (["s3://bucket/x.mp4"], "nothing here reads s3://"),
        (["{0}/web.webm", "{0}/web.webm"], "would both be called web"),
    ],
)
def test_wrong_sources(videos: Path, tmp_path: Path, sources: list[str], why: str, capsys: Any) -> None:
    words = [source.format(videos) for source in sources]
    assert main([*PEOPLE, *words, "--out", str(tmp_path / "o")]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_wrong_calls(videos: Path, tmp_path: Path) -> None:
    for call, why in (
        (lambda: tsuiseki.batch("track nobody", videos, tmp_path / "o"), "expected a command such as"),
        (lambda: tsuiseki.batch("track people", videos, tmp_path / "o", framez="1-2"), "got 'framez'"),
        (lambda: tsuiseki.batch("track people", videos, tmp_path / "o", method="best"), "method"),
        (lambda: tsuiseki.batch("track people", videos, tmp_path / "o", gpus=0.5), "`gpus` with `ray`"),
    ):
        with pytest.raises(RequestError, match=why):
            call()


class Cut(http.server.SimpleHTTPRequestHandler):
    """A server that breaks off what it sends for the first time."""

    left = 1

    def log_message(self, *_: Any) -> None: ...

    def copyfile(self, source: Any, outputfile: Any) -> None:
        if Cut.left and self.path.endswith("still.avi"):
            Cut.left -= 1
            outputfile.write(source.read(1000))
            self.close_connection = True
            return
        super().copyfile(source, outputfile)


@pytest.fixture
def server(videos: Path) -> Iterator[str]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Cut, directory=str(videos))) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{served.server_address[1]}"
        served.shutdown()


@pytest.mark.slow
def test_an_address_is_fetched_again_where_the_network_is_cut(
    server: str, videos: Path, networks: list[str], tmp_path: Path, here: Any
) -> None:
    pytest.importorskip("aiohttp")
    words = [f"{server}/still.avi", *networks, "--view", "1"]
    assert main([*PEOPLE, *words, "--out", str(tmp_path / "o")]) == 0
    assert Cut.left == 0
    assert here.kinds().count("begin") == 2
    tracks = tmp_path / "o/still/tracks.txt"
    assert main(["track", "people", str(videos / "still.avi"), *words[1:], "--out", str(tmp_path / "one")]) == 0
    assert tracks.read_bytes() == (tmp_path / "one/tracks.txt").read_bytes()
    assert [path.name for path in (tmp_path / "o/.batch/still").iterdir()] == ["made.json"]
    assert main([*PEOPLE, f"{server}/gone.avi", *networks, "--out", str(tmp_path / "gone")]) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_results_are_counted_and_scored(
    videos: Path, networks: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "o"
    tsuiseki.batch("track people", [videos / "still.avi", videos / "web.webm"], results, view="1", detector=networks[1])
    scene = tmp_path / "scene.yaml"
    scene.write_text("size: [80, 48]\nlines: [{name: door, from: [40, 0], to: [40, 48], directions: [in, out]}]\n")
    words = ["batch", "count", str(results), "--scene", str(scene), "--out", str(tmp_path / "counts")]
    assert main(words) == 0, capsys.readouterr().err
    assert (tmp_path / "counts/still/answers.json").is_file()
    assert "<dt>door, in</dt><dd>0</dd>" in (tmp_path / "counts/index.html").read_text()
    truth = tmp_path / "truth"
    truth.mkdir()
    for name in ("still", "web"):
        (truth / f"{name}.txt").write_text("1,1,8,8,16,32,1,1,1\n2,1,8,8,16,32,1,1,1\n")
    words = ["batch", "evaluate", "people", str(truth / "*.txt"), "--results", str(results / "{name}" / "tracks.txt")]
    assert main([*words, "--out", str(tmp_path / "scores")]) == 0, capsys.readouterr().err
    assert (tmp_path / "scores/web/scores.json").is_file()
    assert main([*words, "--out", str(tmp_path / "scores")]) == 0
    assert "2 kept" in capsys.readouterr().out


def sequences(folder: Path) -> Path:
    """Two sequences of text, in each of which another number of people walks to the right for 20 frames."""
    for count in (1, 3):
        det = folder / f"S-{count}" / "det" / "det.txt"
        det.parent.mkdir(parents=True)
        boxes = [f"{n},-1,{2 * n},{100 * k + 1},30,80,0.9\n" for n in range(1, 21) for k in range(count)]
        det.write_text("".join(boxes))
        lines = "[Sequence]", "frameRate=25", "seqLength=20", "imWidth=640", "imHeight=480"
        det.parent.with_name("seqinfo.ini").write_text("\n".join(lines))
    return folder


@pytest.mark.slow
@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("options", [[], ["--detections", "det/det.txt"]])
def test_58_37_each_sequence_of_text_has_its_own_detections(options: list[str], tmp_path: Path) -> None:
    folder = sequences(tmp_path / "sequences")
    main([*PEOPLE, str(folder), "--out", str(tmp_path / "out"), "--method", "sort", *options])
    assert [len(tsuiseki.read_tracks(tmp_path / "out" / f"S-{n}" / "tracks.txt")) for n in (1, 3)] == [1, 3]


def test_58_37_detections_that_the_options_name_win(tmp_path: Path) -> None:
    folder, elsewhere = sequences(tmp_path / "sequences"), tmp_path / "det.txt"
    elsewhere.write_text("1,-1,1,1,30,80,0.9\n")
    (job,) = jobs_of([str(folder / "S-1")], Job(("track", "people"), "", "", {"detections": str(elsewhere)}))
    assert job.request(job.source, tmp_path).arguments.arguments["finding"].detections == elsewhere
    (job,) = jobs_of([str(folder / "S-1")], Job(("track", "people"), "", "", {"detector": "detector_people"}))
    assert job.request(job.source, tmp_path).arguments.arguments["finding"].detections is None
