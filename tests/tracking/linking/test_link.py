"""The same people in two cameras that do not overlap."""

from __future__ import annotations

import csv
from dataclasses import fields, replace

import cv2
import numpy as np
import pytest

import tsuiseki
from tests.tracking.counts.walkers import walker
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.linking.transits import MARGIN, Passages, Transits, linked, people_of, standing_out
from tsuiseki.tracking.people.tracks_of_source import tracked
from tsuiseki.tracking.result import Result


def street(
    seed: int, people: int = 40, every: float = 20.0, likeness: float = 0.6, shared: float = 0.75
) -> tuple[Passages, np.ndarray]:
    """Two cameras on one street, 15 s apart: a share of those who leave one enter the other; and who each one is."""
    rng, rows, time = np.random.default_rng(seed), [], 0.0

    def seen() -> np.ndarray:
        row = base + rng.normal(size=32) / np.sqrt(32) * np.sqrt(1 / likeness - 1)
        return row / np.linalg.norm(row)

    for person in range(people):
        time += rng.exponential(every)
        back = rng.random() < 0.4
        left, right = (rng.normal([x, 0.6], 0.02) for x in (0.03, 0.97))
        ends = (right, left) if back else (left, right)
        base = rng.normal(size=32)
        base /= np.linalg.norm(base)
        out = time + rng.uniform(8, 14)
        rows.append((int(back), time, out, *ends, seen(), person))
        if rng.random() < shared:
            again = out + 15 * np.exp(0.2 * rng.normal())
            rows.append((1 - int(back), again, again + 10, *ends, seen(), person))
    columns = [np.array(column) for column in zip(*(rows[k] for k in rng.permutation(len(rows))), strict=True)]
    return Passages(*columns[:6]), columns[6]


def scored(links: Transits, who: np.ndarray) -> tuple[float, float]:
    """Precision and recall of the sure joins."""
    right, sure = who[links.earlier] == who[links.later], links.margins >= MARGIN
    return (right & sure).sum() / sure.sum(), (right & sure).sum() / (len(who) - len(set(who)))


def test_appearance_and_times_find_people_again():
    scores = np.mean([scored(linked(street(seed, every=6)[0]), street(seed, every=6)[1]) for seed in range(4)], axis=0)
    assert scores[0] > 0.97
    assert scores[1] > 0.95


def strangers(seed: int) -> tuple[Passages, np.ndarray]:
    """Two streets of other people: of each, all in its first camera."""
    (first, _), (second, _) = (
        street(seed, people=25, every=12, shared=0),
        street(seed + 50, people=25, every=12, shared=0),
    )
    both = [np.concatenate([getattr(side, f.name) for side in (first, second)]) for f in fields(Passages)]
    return replace(Passages(*both), view=np.repeat([0, 1], 25)), np.arange(50)


@pytest.mark.slow
def test_of_strangers_nobody_is_joined():
    """66.4: at nine to one alone, some would be."""
    every = [linked(strangers(seed)[0]) for seed in range(8)]
    assert sum((links.margins >= MARGIN).sum() for links in every) > 4
    assert sum(standing_out(strangers(seed)[0], links).sum() for seed, links in enumerate(every)) == 0


@pytest.mark.slow
def test_of_joins_of_few_and_many_shared_people_one_in_twenty_is_false():
    """66.4: and nearly as many are right as at nine to one alone."""
    right, made, before = 0, 0, 0
    for shared in (0.2, 0.4, 0.75):
        for seed in range(3):
            passages, who = street(seed, 30, 12, shared=shared)
            links = linked(passages)
            true, sure = who[links.earlier] == who[links.later], standing_out(passages, links)
            right, made = right + (true & sure).sum(), made + sure.sum()
            before += (true & (links.margins >= MARGIN)).sum()
    assert made - right <= 0.05 * made
    assert right >= 0.9 * before


def test_times_alone_find_those_whom_nobody_else_follows():
    scores = []
    for seed in range(4):
        passages, who = street(seed)
        scores.append(scored(linked(replace(passages, features=np.zeros((len(who), 1)))), who))
    assert np.mean(scores, axis=0)[0] > 0.97
    assert np.mean(scores, axis=0)[1] > 0.6


def test_twins_at_one_time_are_unsure():
    """Two leave together and two enter together, all alike: either way is as likely."""
    begin = np.cumsum([0, 61, 97, 45, 130, 70, 0.0])
    times = np.concatenate([begin, begin + 20])
    ends = np.repeat([[0.9, 0.5], [0.1, 0.5]], 7, axis=0)
    links = linked(Passages(np.repeat([0, 1], 7), times, times + 10, ends, ends, np.zeros((14, 1))))
    twins = links.earlier >= 5
    assert twins.sum() == 2
    assert np.allclose(links.margins[twins], 0, atol=1e-4)
    assert (links.margins[~twins] > MARGIN).all()


def test_the_margin_is_what_the_best_solution_without_the_link_costs_more():
    passages, _ = street(0, people=6, every=60)
    links = linked(passages)
    assert len(links.earlier) > 1
    assert (links.margins > 0).all()


def test_joined_tracks_have_one_id():
    links = Transits(np.array([0, 2]), np.array([2, 3]), np.zeros(2), np.ones(2), np.zeros(2))
    assert people_of(5, links, np.array([True, True])).tolist() == [1, 2, 1, 1, 3]
    assert people_of(5, links, np.array([True, False])).tolist() == [1, 2, 1, 3, 4]


def results() -> list[Result]:
    """One walks out of the first view and, 5 s later, into the second; both views run at 10 frames a second."""
    first, second = [], []
    for k, begin in enumerate((0, 310, 790, 1290, 1610, 2350)):
        feet = np.column_stack([np.linspace(20, 180, 50), np.full(50, 90)])
        first.append(walker(feet, k + 1, np.arange(begin, begin + 50)))
        second.append(walker(feet, k + 7, np.arange(begin + 100 + k, begin + 150 + k)))
    return [Result(tracks, "", 10.0, (200, 100)) for tracks in (first, second)]


def test_results_get_common_ids_and_the_command_writes_them(tmp_path, capsys):
    found = tsuiseki.link(results(), appearance="none")
    assert [track.id for track in found.results[0]] == [track.id for track in found.results[1]] == [1, 2, 3, 4, 5, 6]
    assert found.joins[0][:6] == (1, "1_images", 1, "2_images", 7, pytest.approx(5.1))
    for k, result in enumerate(results()):
        result.save(tmp_path / f"view{k}")
    words = ["link", str(tmp_path / "view0"), str(tmp_path / "view1"), "--out", str(tmp_path / "out")]
    assert main([*words, "--appearance", "none"]) == 0
    assert "6 people, 6 joins, " in capsys.readouterr().out
    assert len(tsuiseki.read_tracks(tmp_path / "out" / "view1" / "tracks.txt")) == 6
    assert len(list(csv.reader((tmp_path / "out" / "joins.csv").read_text().splitlines()))) == 7
    assert (tmp_path / "out" / "unsure.csv").read_text().startswith("id,result")


def test_cameras_that_share_nobody_are_said_and_starts_are_asked_for(tmp_path, capsys):
    for k, result in enumerate(results()):
        replace(result, tracks=result.tracks[: 1 + 2 * k]).save(tmp_path / f"view{k}")
    words = ["link", str(tmp_path / "view0"), str(tmp_path / "view1"), "--appearance", "none", "--overwrite"]
    for more, asked in (([], True), (["--starts", "0,5000"], False)):
        assert main([*words, *more, "--out", str(tmp_path / "out")]) == 0
        said = capsys.readouterr().out
        assert "4 people, 0 joins, " in said
        assert "these cameras share nobody, or few" in said
        assert ("give --starts" in said) == asked


def test_files_of_tracks_take_their_frames_a_second_from_the_user(tmp_path):
    for k, result in enumerate(results()):
        tsuiseki.write_tracks(tmp_path / f"{k}.txt", result.tracks)
    words = ["link", str(tmp_path / "0.txt"), str(tmp_path / "1.txt"), "--appearance", "none", "--fps", "10"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert len(list(csv.reader((tmp_path / "out" / "joins.csv").read_text().splitlines()))) == 7


def test_files_that_follow_begin_when_they_are_said_to():
    first, second = results()
    later = replace(second, tracks=[replace(t, frames=t.frames - 90) for t in second.tracks[:1]])
    found = tsuiseki.link([replace(first, tracks=first.tracks[:1]), later], starts=[0, 10], appearance="none")
    rows = [*found.joins, *found.unsure]
    assert rows[0][5] == pytest.approx(11 - 4.9)


def test_bad_input_is_refused_in_a_line():
    first, second = results()
    with pytest.raises(RequestError, match="two results or more"):
        tsuiseki.link([first])
    with pytest.raises(RequestError, match="the same tracks in 1_images and 2_images"):
        tsuiseki.link([first, first])
    with pytest.raises(RequestError, match="tracks of people with boxes, got none"):
        tsuiseki.link([first, replace(second, tracks=[])])
    with pytest.raises(RequestError, match="`starts`: expected 2 numbers"):
        tsuiseki.link([first, second], starts=[0.0])
    with pytest.raises(RequestError, match="frames a second, which the result does not say; give `fps`"):
        tsuiseki.link([first, replace(second, frame_rate=0.0)], appearance="none")
    with pytest.raises(RequestError, match="`margin`: expected 0 or more, got -3"):
        tsuiseki.link([first, second], margin=-3.0)
    with pytest.raises(RequestError, match="`fps`: expected 1 number or 2, one a source, above 0, got 10,0"):
        tsuiseki.link([first, second], frame_rates=[10.0, 0.0])
    with pytest.warns(InputWarning, match="linked by times alone"):
        tsuiseki.link([first, second])


def test_a_generated_sequence_is_tracked_as_a_video(tmp_path):
    (tmp_path / "img1").mkdir()
    cv2.imwrite(str(tmp_path / "img1" / "000001.png"), np.zeros((90, 160, 3), np.uint8))
    (tmp_path / "seqinfo.ini").write_text("[Sequence]\nname=a\nframeRate=10\nseqLength=1\nimDir=img1\nimExt=.png\n")
    (tmp_path / "run.json").write_text('{"what": "a simulation"}')
    with pytest.raises(RequestError, match="tracks of people with boxes, got none"):
        tracked(tmp_path)
