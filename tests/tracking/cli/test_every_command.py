"""Every command runs once with good input: here where it takes no time, or in the test that is named."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.cameras.intrinsic_files import write_intrinsics
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import COMMANDS, Group

REPOSITORY = Path(__file__).resolve().parents[3]
NOT_BY_DEFAULT = ("thesis_size", "gpu", "data_folder")
EXPERIMENTS = "tests/trainers/experiments"

# The test, or the fixture that the tests beside it use, in which the command ends well.
ELSEWHERE = {
    "demo": "tests/tracking/demo/test_demo.py::test_demo_leaves_a_result_for_each_method_and_a_report",
    "simulate sphere": "tests/tracking/sphere/test_sphere_commands.py::film",
    "simulate blobs": "tests/tracking/points/test_blob_commands.py::clip",
    "simulate goldfish": "tests/tracking/cli/test_simulate.py::test_a_clip_is_the_same_for_the_same_seed",
    "simulate drone": (
        "tests/datamodules/scenes/test_drone_clip.py::test_the_command_writes_a_clip_and_refuses_nonsense"
    ),
    "simulate fisheye": "tests/tracking/fisheye/test_fisheye_commands.py::room",
    "simulate sprites": "tests/datamodules/scenes/figures/test_sprites.py::library",
    "train detector": (
        "tests/trainers/networks/test_fit.py"
        "::test_a_training_that_began_from_an_exported_file_goes_on_with_its_own_normalisations"
    ),
    "train appearance": "tests/trainers/networks/test_fit_appearance.py::trained",
    "train action": "tests/datamodules/test_action_readers.py::test_the_command_line_trains_on_drone_action",
    "train affinity": "tests/trainers/association/test_affinity_fit.py::test_fits_from_labels_alone",
    "train affinity-drone": (
        "tests/trainers/association/test_action_cost_fit.py::test_the_command_writes_the_cost_of_actions"
    ),
    "train association": "tests/trainers/association/test_training.py::trained",
    "evaluate appearance": (
        "tests/tracking/evaluation/test_reidentification.py::test_networks_are_compared_on_labelled_video"
    ),
    "detect": (
        "tests/tracking/people/test_detect.py::test_boxes_and_centres_of_the_frames_that_were_asked_for_are_written"
    ),
    "train objectness": (
        "tests/tracking/single/test_single_commands.py::test_objectness_is_learnt_from_folders_and_needs_enough_boxes"
    ),
    "train body": "tests/trainers/test_learn_body.py::test_files_and_commands",
    "train motion": "tests/tracking/bodies/test_deformable_commands.py::motion",
    "adapt": "tests/tracking/cli/test_adapt.py::test_the_best_round_is_written",
    "export detector": (
        "tests/trainers/networks/test_fit.py"
        "::test_a_training_that_began_from_an_exported_file_goes_on_with_its_own_normalisations"
    ),
    "export appearance": (
        "tests/trainers/networks/test_fit_appearance.py::test_exported_network_describes_as_the_trained_one"
    ),
    "export action": "tests/datamodules/test_action_readers.py::test_the_command_line_trains_on_drone_action",
    "export association": (
        "tests/trainers/association/test_training.py::test_an_unfinished_training_is_exported_only_where_asked"
    ),
    "models list": (
        "tests/tracking/weights/test_download.py"
        "::test_the_command_shows_the_terms_fetches_and_the_name_is_a_detector_then"
    ),
    "models get": (
        "tests/tracking/weights/test_download.py"
        "::test_the_command_shows_the_terms_fetches_and_the_name_is_a_detector_then"
    ),
    "calibrate checkerboard": "tests/tracking/cameras/test_checkerboard.py::test_the_command_finds_the_camera",
    "calibrate convert": "tests/tracking/fisheye/test_fisheye_commands.py::test_lenses_are_converted_with_a_residual",
    "calibrate pose": "tests/tracking/fisheye/test_fisheye_commands.py::test_a_pose_from_height_and_from_points",
    "track people": "tests/tracking/people/test_track.py::test_a_person_is_tracked_from_any_source_by_any_method",
    "track single": "tests/tracking/single/test_single_commands.py::test_track_and_evaluate",
    "track sphere": "tests/tracking/sphere/test_sphere_commands.py::test_two_webcams_are_followed_while_they_come",
    "track drone": "tests/tracking/drone/test_track_drone.py::test_report_overlay_and_evaluation",
    "track blobs": "tests/tracking/points/test_blob_commands.py::test_a_clip_is_tracked_and_scored",
    "track points": "tests/tracking/points/test_measurements.py::test_the_command_writes_what_the_function_finds",
    "track deformable": "tests/tracking/bodies/test_deformable_commands.py::test_a_clip_is_tracked_by_what_was_learnt",
    "track animals": (
        "tests/tracking/animals/test_animals_commands.py::test_a_film_is_tracked_in_millimetres_and_evaluated"
    ),
    "track fisheye": "tests/tracking/fisheye/test_fisheye_commands.py::test_given_boxes_become_places",
    "batch track": "tests/tracking/batch/test_batch.py::test_stretches_of_five_videos_give_what_one_process_gives",
    "batch count": "tests/tracking/batch/test_sources.py::test_results_are_counted_and_scored",
    "batch evaluate": "tests/tracking/batch/test_sources.py::test_results_are_counted_and_scored",
    "batch status": "tests/tracking/batch/test_batch.py::test_the_same_command_goes_on_after_a_kill",
    "scene": "tests/tracking/answers/test_drawn_scene.py::test_the_command_writes_what_is_drawn",
    "hide": "tests/tracking/people/test_hiding.py::test_the_command_hides_and_counts_doubtful_frames",
    "count": "tests/tracking/answers/test_count_command.py::test_the_command_writes_tables_plots_and_a_page",
    "evaluate people": "tests/tracking/cli/test_evaluate.py::test_a_partial_result_is_said_to_be_one",
    "evaluate detection": "tests/tracking/cli/test_evaluate.py::test_detections_are_scored",
    "evaluate single": "tests/tracking/single/test_single_commands.py::test_track_and_evaluate",
    "evaluate coverage": (
        "tests/tracking/evaluation/test_target_coverage.py::test_the_command_prints_a_row_and_writes_it"
    ),
    "evaluate points": "tests/tracking/points/test_blob_commands.py::test_a_clip_is_tracked_and_scored",
    "evaluate states": "tests/tracking/evaluation/test_states.py::test_the_command_compares_results",
    "evaluate action": "tests/tracking/drone/test_track_drone.py::test_report_overlay_and_evaluation",
    "convert": "tests/tracking/cli/test_convert.py::test_a_folder_becomes_a_file_of_each_format",
    "reproduce multi-correlation-filter": (
        "tests/tracking/single/test_single_commands.py::test_the_experiment_runs_on_a_folder_and_goes_on_from_its_cache"
    ),
    "reproduce phd": f"{EXPERIMENTS}/test_finite_sets.py::test_the_finite_set_experiment_prints_writes_and_keeps",
    "reproduce pca-particle-filter": f"{EXPERIMENTS}/test_goldfish.py::folders",
    "reproduce drone-action-features": (
        "tests/tracking/cli/test_reproduce_drone.py::test_all_tables_and_figures_and_what_was_there_is_used_again"
    ),
    "reproduce phd-unseen": f"{EXPERIMENTS}/test_sensed.py::test_the_experiment_prints_every_kind",
    "reproduce blobs": f"{EXPERIMENTS}/test_coloured.py::test_both_methods_are_scored_on_every_kind_of_clutter",
    "reproduce phd-equalisation": f"{EXPERIMENTS}/test_coloured.py::test_equalisation_reports_all_updates",
    "reproduce association": f"{EXPERIMENTS}/test_association.py::test_every_row_is_measured_and_kept",
    "reproduce end-to-end": f"{EXPERIMENTS}/test_end_to_end.py::test_all_rows_and_again_from_the_store",
    "reproduce omnidirectional": f"{EXPERIMENTS}/test_fisheye.py::test_the_command_goes_to_the_end",
    "reproduce stereo-sphere": f"{EXPERIMENTS}/test_sphere.py::test_the_experiment_prints_writes_and_keeps",
    "reproduce answers": f"{EXPERIMENTS}/test_answers.py::test_a_street_is_counted_and_told",
    "reproduce sphere-points": f"{EXPERIMENTS}/test_sphere_points.py::test_the_experiment_prints_every_row",
}


def street(folder: Path) -> tuple[list[str], str]:
    size = ["--frames", "2", "--people", "2", "--width", "160", "--height", "96"]
    return [*size, "--out", str(folder / "clip")], "clip/gt/gt.txt"


def points(folder: Path) -> tuple[list[str], str]:
    """Points that a camera of known lens sees."""
    lens = Intrinsics(640, 480, np.array([210.0, 212]), np.array([320.5, 240.5]), np.array([0.1, 0, 0, 0, 0]))
    write_intrinsics(folder / "lens.yaml", lens, 0.0)
    places = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 4], (8, 3))
    rows = np.column_stack([places, lens.camera().project(places)[0]])
    np.savetxt(folder / "points.csv", rows, delimiter=",", header="x,y,z,u,v")
    given = [str(folder / "points.csv"), "--intrinsics", str(folder / "lens.yaml")]
    return [*given, "--out", str(folder / "cameras.yaml")], "cameras.yaml"


# The words after the command, and a file that it writes.
HERE: dict[str, Callable[[Path], tuple[list[str], str]]] = {"simulate street": street, "calibrate points": points}


def test_no_command_is_left_out() -> None:
    every = {
        f"{name} {inner}".strip()
        for name, one in COMMANDS.items()
        for inner in (one.commands if isinstance(one, Group) else ("",))
    }
    assert every == HERE.keys() | ELSEWHERE.keys()
    assert not HERE.keys() & ELSEWHERE.keys()


@pytest.mark.parametrize("command", HERE)
def test_a_good_request_ends_well(command: str, tmp_path: Path) -> None:
    words, written = HERE[command](tmp_path)
    assert main([*command.split(), *words]) == 0
    assert (tmp_path / written).is_file()


def text_of(place: str, name: str) -> str:
    """The function ``name`` of a file of tests, and those of the file that it takes or calls."""
    text = (REPOSITORY / place).read_text(encoding="utf-8")
    functions = {node.name: node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
    assert name in functions, f"{place} has no {name}"
    taken, open_names = dict[str, str](), [name]
    while open_names:
        current = open_names.pop()
        taken[current] = ast.unparse(functions[current])
        used = {n.id for n in ast.walk(functions[current]) if isinstance(n, ast.Name)}
        used |= {argument.arg for argument in functions[current].args.args}
        open_names += [other for other in functions if other in used and other not in taken]
    return "\n".join(taken.values())


@pytest.mark.parametrize("command", ELSEWHERE)
def test_the_named_test_runs_the_command(command: str) -> None:
    text = text_of(*ELSEWHERE[command].split("::"))
    assert not any(word in text for word in NOT_BY_DEFAULT), f"{ELSEWHERE[command]} does not run by default"
    assert ", ".join(f"'{word}'" for word in command.split()) in text, f"{ELSEWHERE[command]} has no {command}"
    assert re.search(r"(main|track|run)\(.*== 0|status == 0", text), f"{ELSEWHERE[command]} asks for no good end"
