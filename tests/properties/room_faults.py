"""Three faults in each of twelve rooms, and the test that catches each: any test but the properties."""

from __future__ import annotations

from tests.properties.planted import Fault

PEOPLE = "tracking/people/"
SINGLE = "tracking/single/"
DRONE = "tracking/drone/"
FISHEYE = "tracking/fisheye/"
BODIES = "tracking/bodies/"
ANIMALS = "tracking/animals/"
POINTS = "tracking/points/"
SPHERE = "tracking/sphere/"
COUNTS = "tracking/counts/"
FLOOR = "tracking/floor/"
HIDING = "tracking/hiding/places.py"
LINKING = "tracking/linking/"

# By room: the file, the text, what it becomes, and the test below tests/tracking.
CHANGES = {
    "people": [
        (
            PEOPLE + "bytetrack.py",
            "left = self._misses == 0",
            "left = self._misses >= 0",
            "people/test_bytetrack.py::test_only_a_sure_detection_brings_a_lost_track_back",
        ),
        (
            PEOPLE + "ocsort.py",
            "/ np.pi - 0.5, 0.0)",
            "/ np.pi + 0.5, 0.0)",
            "people/test_ocsort.py::test_a_turn_costs_its_angle",
        ),
        (
            PEOPLE + "lifecycle.py",
            "young = self._misses < self.settings.max_age",
            "young = self._misses <= self.settings.max_age",
            "people/test_bytetrack.py::test_a_lost_track_is_kept_for_its_age",
        ),
    ],
    "single": [
        (
            SINGLE + "search_windows.py",
            "return 0.5 * (right - left) / curvature if",
            "return 0.5 * (left - right) / curvature if",
            "single/test_response.py::test_climbing_ends_on_the_maximum_between_cells",
        ),
        (
            SINGLE + "search_windows.py",
            "(np.abs(x) <= columns / 2) & (np.abs(y) <= rows / 2)",
            "np.abs(x) <= columns / 2",
            "single/test_response.py::test_outside_the_window_there_is_no_response",
        ),
        (
            SINGLE + "selection.py",
            "np.array([x, y, x + width, y + height])",
            "np.array([x, y, width, height])",
            "single/test_selection.py::test_the_page_shows_the_image_and_takes_the_box",
        ),
    ],
    "drone": [
        (
            DRONE + "tracker.py",
            "single = np.stack([np.interp(track.frames, frames, column)",
            "single = np.stack([np.interp(track.frames, frames, 1 - column)",
            "drone/test_drone_tracker.py::test_between_detections_what_somebody_does_changes_evenly",
        ),
        (
            DRONE + "tracker.py",
            "self._path.follow(motion or CameraStep(STANDS_STILL))",
            "self._path.follow(CameraStep(STANDS_STILL))",
            "drone/test_drone_tracker.py::test_a_moving_camera_is_taken_out",
        ),
        (
            DRONE + "observations.py",
            "content[: len(MAGIC) + 4], content[len(MAGIC) + 4 :]",
            "content[: len(MAGIC) + 4], content[len(MAGIC) + 5 :]",
            "drone/test_track_drone.py::test_the_cache_saves_looking_and_survives_damage",
        ),
    ],
    "fisheye": [
        (
            FISHEYE + "tracker.py",
            "costs = np.where(away > gate, np.inf, costs)",
            "costs = np.where(away > 100 * gate, np.inf, costs)",
            "fisheye/test_fisheye_tracker.py::test_like_clothes_far_away_are_somebody_else",
        ),
        (
            FISHEYE + "unrolled.py",
            "angle = np.arctan2(upward[:, 0], -upward[:, 1])",
            "angle = np.arctan2(upward[:, 0], upward[:, 1])",
            "fisheye/test_unrolled.py::test_everybody_is_found_once_where_they_stand",
        ),
        (
            FISHEYE + "unrolled.py",
            "return np.asarray((feet > 0) & (above >= HEIGHTS[0])",
            "return np.asarray((feet > 0)",
            "fisheye/test_unrolled.py::test_what_is_no_height_of_people_is_left_out",
        ),
    ],
    "bodies": [
        (
            BODIES + "contour.py",
            "HIDDEN_COST * np.maximum(hidden - self.hidden, 0.0)",
            "HIDDEN_COST * np.maximum(hidden + self.hidden - 1, 0.0)",
            "bodies/test_contour.py::test_hidden_points_take_no_part_and_cost_their_share",
        ),
        (
            BODIES + "contour.py",
            "look_up(image.distance, points - EDGE_OFFSET)",
            "look_up(image.distance, points)",
            "bodies/test_contour.py::test_there_is_no_shift_between_contours_and_edges",
        ),
        (
            BODIES + "body.py",
            "terms = np.concatenate([np.ones_like(phi), np.cos(phi), np.sin(phi)]",
            "terms = np.concatenate([np.ones_like(phi), np.cos(phi), -np.sin(phi)]",
            "bodies/test_bodies.py::test_positive_bend_puts_the_tail_on_the_side_of_growing_heading",
        ),
    ],
    "animals": [
        (
            ANIMALS + "tracker.py",
            "away[label] > REACH * animal.length",
            "away[label] > 100 * animal.length",
            "animals/test_animals.py::test_animals_expected_far_away_have_no_part_in_a_region",
        ),
        (
            ANIMALS + "tracker.py",
            "cores[n] > SEVERAL * usual and not",
            "cores[n] > SEVERAL * usual and",
            "animals/test_animals.py::test_a_large_one_is_one_and_two_side_by_side_are_two",
        ),
        (
            ANIMALS + "linking.py",
            "if _gain(appearances) > EVIDENCE:",
            "if _gain(appearances) < EVIDENCE:",
            "animals/test_animals.py::test_looks_exchange_two_that_the_flow_confused",
        ),
    ],
    "points": [
        (
            POINTS + "tracker.py",
            "if name in waiting and frames >= SHORTEST]",
            "if name in waiting and frames > 1000]",
            "points/test_blobs.py::test_points_are_tracked_whole_and_frame_by_frame",
        ),
        (
            POINTS + "tracker.py",
            "boxes = np.concatenate([centres - size / 2, centres + size / 2], axis=1)\n        # The nearest",
            "boxes = np.concatenate([centres, centres + size], axis=1)\n        # The nearest",
            "points/test_blobs.py::test_points_are_tracked_whole_and_frame_by_frame",
        ),
        (
            POINTS + "observed.py",
            "acceleration=CALM * motion.acceleration",
            "acceleration=motion.acceleration",
            "points/test_measurement_tables.py::test_a_calm_target_is_placed_better_than_the_whole_acceleration_allows",
        ),
    ],
    "sphere": [
        (
            SPHERE + "views.py",
            "centre = outlines.centre - 0.5",
            "centre = outlines.centre + 0.5",
            "sphere/test_likelihood.py::test_the_polar_samples_lie_where_the_outline_says",
        ),
        (
            SPHERE + "views.py",
            "inside &= (rows[-1] >= 0) & (rows[-1] <= camera.height - 1)",
            "inside &= rows[-1] >= -1e9",
            "sphere/test_likelihood.py::test_of_an_outline_that_leaves_the_picture_that_share_counts_which_lies_in_it",
        ),
        (
            SPHERE + "views.py",
            "np.median(np.stack(images), axis=0)",
            "np.mean(np.stack(images), axis=0)",
            "sphere/test_likelihood.py::test_the_median_forgets_what_covers_a_pixel_less_than_half_the_time",
        ),
    ],
    "counts": [
        (
            COUNTS + "companions.py",
            "if earlier not in successors and later not in followed:",
            "if earlier not in successors:",
            "counts/test_companions.py::test_of_two_who_vanish_behind_somebody_the_last_one_comes_out",
        ),
        (
            COUNTS + "paths.py",
            "observed[gaps] = new[gaps] = False",
            "new[gaps] = False",
            "counts/test_crossings.py::test_no_detection_supports_the_places_in_a_gap",
        ),
        (
            COUNTS + "line_tables.py",
            "ends = part * interval, min((part + 1) * interval, seconds)",
            "ends = part * interval, (part + 1) * interval",
            "counts/test_counting.py::test_flows_are_summed_by_interval_up_to_the_end_of_the_video",
        ),
    ],
    "linking": [
        (
            LINKING + "transits.py",
            "margins = [solve(graph.with_transitions(mask)).cost - best.cost",
            "margins = [best.cost - solve(graph.with_transitions(mask)).cost",
            "linking/test_link.py::test_the_margin_is_what_the_best_solution_without_the_link_costs_more",
        ),
        (
            LINKING + "transits.py",
            "gains[described] += _normal(s, *self.same) - _normal(s, *self.different)",
            "gains[described] -= _normal(s, *self.same) - _normal(s, *self.different)",
            "linking/test_link.py::test_appearance_and_times_find_people_again",
        ),
        (
            LINKING + "transits.py",
            "return_inverse=True)[1] + 1, dtype=np.int64)",
            "return_inverse=True)[1], dtype=np.int64)",
            "linking/test_link.py::test_joined_tracks_have_one_id",
        ),
    ],
    "floor": [
        (
            FLOOR + "grouping.py",
            "return np.asarray((point_names >= 0) & (named[g] >= 0) & (point_names != named[g]))",
            "return np.asarray((point_names >= 0) & (named[g] >= 0) & (point_names == named[g]))",
            "floor/test_one_floor.py::test_certain_names_keep_apart",
        ),
        (
            FLOOR + "grouping.py",
            "alone = points.gain[mine] + self.density",
            "alone = points.gain[mine] - self.density",
            "floor/test_one_floor.py::test_the_more_people_are_expected_the_sooner_two_points_are_two",
        ),
        (
            FLOOR + "walking.py",
            "mean[:, :2] += seconds[:, None] * mean[:, 2:]",
            "mean[:, :2] -= seconds[:, None] * mean[:, 2:]",
            "floor/test_one_floor.py::test_positions_alone_are_tracked",
        ),
    ],
    "hiding": [
        (
            HIDING,
            "hidden[y1:y2, x1:x2] = GREY",
            "hidden[y1:y2, x1 + 1:x2] = GREY",
            "hiding/test_hiding.py::test_painting_changes_the_inside_alone_and_keeps_no_detail",
        ),
        (
            HIDING,
            "(BASE + SCORE * (1 - scores))",
            "(BASE + SCORE * scores)",
            "hiding/test_hiding.py::test_doubt_widens",
        ),
        (
            HIDING,
            "HOLD), SPREAD)",
            "HOLD), 0 * SPREAD)",
            "hiding/test_hiding.py::test_a_second_before_and_after_moves_on_as_the_track_does",
        ),
    ],
}
ROOMS = {
    room: [Fault(file, old, new, f"tests/tracking/{test}") for file, old, new, test in changes]
    for room, changes in CHANGES.items()
}
