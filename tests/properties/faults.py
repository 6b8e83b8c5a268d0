"""The fault that each property must catch: its file, the text that stands there once, and what it becomes."""

from __future__ import annotations

from tests.properties.planted import Fault

EVALUATION = "tracking/evaluation/"
IDENTITY = EVALUATION + "identity_metrics.py"
DISTANCES = EVALUATION + "point_distances.py"
FLOW = "tracking/association/network_flow.py"
RESIDUAL = "tracking/association/residual_flow.py"
ASSIGNMENT = "tracking/association/assignment.py"
GEOMETRY = "tracking/geometry.py"
POLYGONS = "tracking/counts/polygons.py"
PROJECTIVE = "tracking/cameras/projective.py"
FISHEYE = "tracking/cameras/omnidirectional.py"
CALIBRATION = "tracking/cameras/calibration.py"
KALMAN = "tracking/filters/kalman.py"
RESAMPLING = "tracking/filters/resampling.py"
PARTICLES = "tracking/filters/particle_filter.py"
CORRELATION = "tracking/filters/correlation_filters.py"
SETS = "tracking/filters/finite_sets/"
LABELLED = SETS + "labelled_multi_bernoulli.py"
LIFECYCLE = "tracking/people/lifecycle.py"
CROSSINGS = "tracking/counts/crossings.py"
TRANSITS = "tracking/linking/transits.py"
BODY = "tracking/bodies/body.py"
LEARN = "trainers/learn_body.py"
FORMATS = "tracking/formats/"
MOT = FORMATS + "mot.py"
TABLES = FORMATS + "track_tables.py"

METRICS = {
    "hota_is_that_of_all_matchings": (IDENTITY, "alignment[true[:, None], reported[None]] * shared", "shared"),
    "mota_is_that_of_all_matchings": (IDENTITY, "previous[:] = unmatched", "previous[who] = unmatched"),
    "idf1_is_that_of_all_renamings": (
        IDENTITY,
        "common[true[:, None], reported[None]] += shared >= least",
        "common[true[:, None], reported[None]] += shared",
    ),
    "scores_do_not_depend_on_names": (IDENTITY, "(last[who] != whom)).sum()", "(last[who] < whom)).sum()"),
    "scores_do_not_depend_on_the_unit": (
        GEOMETRY,
        "union = areas(a) + areas(b) - shared",
        "union = areas(a) + areas(b) - shared + 1",
    ),
    "a_sequence_and_its_copies_score_as_it_alone": (IDENTITY, "mine + theirs for mine", "max(mine, theirs) for mine"),
    "ospa_is_that_of_all_assignments": (DISTANCES, "cost = np.minimum(distances, c) ** p", "cost = distances**p"),
    "ospa_is_a_metric": (DISTANCES, "Ospa((near + missing) ** (1 / p)", "Ospa((near + missing)"),
    "gospa_is_that_of_all_partial_assignments": (
        DISTANCES,
        "false = c**p / 2 * (len(truth) - assigned), c**p / 2",
        "false = c**p / 2 * (len(truth) - assigned), c**p",
    ),
    "the_distance_of_two_tracks_is_the_mean_over_their_frames": (
        DISTANCES,
        "np.where(either, c, 0.0))",
        "np.where(there_a[:, None], c, 0.0))",
    ),
    "average_precision_is_that_of_all_thresholds": (
        EVALUATION + "detection.py",
        "overlaps[:, best] = -1.0",
        "overlaps[k, best] = -1.0",
    ),
    "average_precision_depends_on_the_order_of_scores_alone": (
        EVALUATION + "detection.py",
        "hits = np.cumsum(right[order])",
        "hits = np.cumsum(right)",
    ),
    "the_area_under_the_success_curve_is_the_mean_over_thresholds": (
        EVALUATION + "success_curves.py",
        "overlaps[None] > OVERLAPS",
        "overlaps[None] >= OVERLAPS",
    ),
    "retrieval_is_that_of_its_definition": (
        EVALUATION + "reidentification.py",
        "(precision * hits).sum(axis=1)",
        "precision.sum(axis=1)",
    ),
}
FLOWS = {
    "the_flow_is_the_cheapest_of_all": (
        FLOW,
        "(place[fresh], birth, scaled(graph.entry[fresh]))",
        "(place[fresh], birth, scaled(graph.exit[fresh]))",
    ),
    "the_flow_is_the_optimum_of_a_linear_programme": (FLOW, "np.rint(costs * SCALE)", "np.rint(costs)"),
    "tracks_of_a_flow_are_disjoint_and_in_order": (
        FLOW,
        "follower[predecessor[linked]] = fresh[linked]",
        "follower[fresh[linked]] = predecessor[linked]",
    ),
    "links_too_dear_to_be_used_change_nothing": (FLOW, "cost < entry + exit)", "cost < entry)"),
    "marginals_are_those_of_all_flows": (
        "tracking/association/marginals.py",
        "into[first] + out[last]",
        "into[last] + out[first]",
    ),
    "constraints_give_the_cheapest_flow_that_holds_them": (
        RESIDUAL,
        "np.minimum(distance, min(distance[target], limit))",
        "distance",
    ),
    "an_assignment_makes_all_pairs_it_can_at_the_least_cost": (
        ASSIGNMENT,
        "(limit - lowest + 1.0) * (min(costs.shape) + 1)",
        "limit - lowest + 1.0",
    ),
    "overlaps_are_matched_for_the_greatest_sum": (ASSIGNMENT, "np.where(valid, overlaps, 0)", "overlaps"),
    "association_marginals_are_those_of_all_associations": (
        SETS + "pairs.py",
        "claim.sum(axis=1, keepdims=True) - claim + SMALLEST",
        "claim.sum(axis=1, keepdims=True)",
    ),
}
TRACKERS = {
    "the_order_of_detections_does_not_matter[Sort]": (
        "tracking/people/sort.py",
        "matched, detected = assign(1 - iou_matrix(predicted, detections.boxes), 1 - least)",
        "matched = detected = np.arange(min(len(predicted), len(detections)))",
    ),
    "tracks_move_with_the_picture[ByteTrack]": (
        GEOMETRY,
        "size: FloatArray = np.clip(boxes[..., 2:] - boxes[..., :2]",
        "size: FloatArray = np.clip(boxes[..., 2:] - 0.9 * boxes[..., :2]",
    ),
    "tracks_grow_with_the_picture[OcSort]": (
        KALMAN,
        "moved = belief.boxes + t[..., None]",
        "moved = belief.boxes + 1 + t[..., None]",
    ),
    "tracks_begin_later_after_empty_frames[Sort]": (
        LIFECYCLE,
        "self._record.append(self._clock.frame - 1, numbers",
        "self._record.append(len(self._record._rows), numbers",
    ),
    "a_detection_supports_one_track[DeepSort]": (LIFECYCLE, "free[detected] = False", "free[detected[:1]] = False"),
    "what_was_answered_stays[Sort]": (
        LIFECYCLE,
        "rows = np.concatenate([boxes[present], origin]",
        "rows = np.concatenate([detections.boxes[detected], origin]",
    ),
    "the_flow_does_not_depend_on_the_order_of_detections": (
        FLOW,
        "birth, scaled(graph.entry[fresh]))",
        "birth, scaled(graph.entry[fresh] + 20 * (fresh % 2)))",
    ),
    "the_flow_grows_with_the_picture": (
        "tracking/association/link_cost.py",
        "self.side = np.maximum(*self.place[2:])",
        "self.side = np.full(len(self.place[0]), 4.0)",
    ),
}
BOXES = {
    "overlaps_are_those_of_counted_pixels": (
        GEOMETRY,
        "union = areas(a) + areas(b) - shared",
        "union = areas(a) + areas(b)",
    ),
    "overlaps_are_symmetric_and_without_a_unit": (GEOMETRY, "union = areas(a) + areas(b) - shared", "union = areas(a)"),
    "corners_and_sizes_say_the_same": (
        GEOMETRY,
        "xywh[..., :2] + xywh[..., 2:]]",
        "xywh[..., :2] + xywh[..., 2:] - 1]",
    ),
    "what_several_boxes_share_with_one_lies_between_most_and_sum": (
        GEOMETRY,
        ".any(axis=1)\n    return np.asarray(inside",
        ".all(axis=1)\n    return np.asarray(inside",
    ),
    "suppression_leaves_the_best_of_those_that_overlap": (
        GEOMETRY,
        "xywh_from_corners(boxes).tolist(), positive",
        "boxes.tolist(), positive",
    ),
    "clipped_boxes_are_the_part_in_the_picture": (
        GEOMETRY,
        "[width, height, width, height]",
        "[height, width, height, width]",
    ),
    "boxes_that_are_not_turned_overlap_as_upright_ones": (
        GEOMETRY,
        "boxes[:, [3, 2]] * sin) / 2",
        "boxes[:, [3, 2]]) / 2",
    ),
    "turned_boxes_overlap_the_same_after_a_turn": (GEOMETRY, "float(np.degrees(b[4]))", "float(np.degrees(-b[4]))"),
    "a_box_about_a_turned_one_touches_its_outermost_corners": (
        GEOMETRY,
        "cos + boxes[:, [3, 2]] * sin",
        "cos + boxes[:, 2:4] * sin",
    ),
    "a_camera_step_and_its_undoing_leave_boxes_in_place": (
        "tracking/features/camera_motion.py",
        "(second @ first)[:2]",
        "(first @ second)[:2]",
    ),
    "points_lie_in_a_polygon_where_the_angles_to_its_corners_go_round": (POLYGONS, "odd ^= ", "odd |= "),
    "areas_and_distances_keep_their_measure": (POLYGONS, "/ (edge @ edge), 0, 1)", "/ (edge @ edge), 0, 2)"),
}
CAMERAS = {
    "rays_and_pixels_of_a_pinhole_camera_are_inverse": (
        PROJECTIVE,
        "local[:2] = undistort(local[:2].T, self.distortion).T",
        "pass",
    ),
    "nothing_beside_or_behind_a_camera_has_a_pixel": (
        PROJECTIVE,
        "pixels[depth <= 0] = np.nan",
        "pixels[depth < 0] = np.nan",
    ),
    "the_matrix_of_a_camera_is_what_it_projects": (
        PROJECTIVE,
        "np.column_stack([np.eye(3), -self.position])",
        "np.column_stack([np.eye(3), self.position])",
    ),
    "distortion_and_its_undoing_are_inverse": (PROJECTIVE, "iterations: int = 12", "iterations: int = 1"),
    "the_ground_below_a_pixel_is_seen_in_it": (GEOMETRY, "(height - position[2])", "(-position[2])"),
    "rays_and_pixels_of_a_fisheye_are_inverse": (FISHEYE, "rho -= (value * across", "rho -= 0.5 * (value * across"),
    "a_larger_picture_of_a_fisheye_shows_the_same_rays": (
        FISHEYE,
        "powers = scale ** (1.0 -",
        "powers = scale ** (2.0 -",
    ),
    "views_around_a_ceiling_camera_invert_their_projection": (
        "tracking/cameras/panorama.py",
        "flat = across[:, None] * right - down[:, None] * up",
        "flat = across[:, None] * right + down[:, None] * up",
    ),
    "a_camera_calibrated_from_its_own_points_is_itself": (
        CALIBRATION,
        "np.linalg.inv(from_image) @ right",
        "from_image @ right",
    ),
    "a_camera_over_a_floor_is_located_by_its_homography": (
        CALIBRATION,
        "np.column_stack([floor, np.zeros(len(floor))])",
        "np.column_stack([floor, np.ones(len(floor))])",
    ),
    "cameras_that_see_a_point_find_it": (
        "tracking/sphere/points.py",
        'b = np.einsum("ncij,cj->ni", across, origins)',
        'b = np.einsum("ncij,cj->ni", across, origins[::-1])',
    ),
    "a_turned_world_looks_the_same": (PROJECTIVE, "@ self.rotation.T)", "@ self.rotation)"),
}
COUNTS = {
    "who_goes_over_a_line_and_back_is_counted_once_each_way": (
        CROSSINGS,
        "np.sign(total[end] - total[start]) == crossed.sides",
        "np.sign(total[end]) == crossed.sides",
    ),
    "crossings_add_up_to_the_change_of_side": (
        CROSSINGS,
        "width[starts] = width[starts[1:] - 1] = width[-1:] = 0.0",
        "pass",
    ),
    "a_film_that_runs_backwards_exchanges_the_directions": (
        CROSSINGS,
        "width[starts] = width[starts[1:] - 1] = width[-1:] = 0.0",
        "width[starts] = 0.0",
    ),
    "a_line_drawn_from_its_other_end_exchanges_the_directions": (
        CROSSINGS,
        "(place >= 0) & (place <= 1)",
        "(place >= 0)",
    ),
    "counts_do_not_depend_on_the_size_of_the_picture": (
        "tracking/counts/line_tables.py",
        "line_crossings(paths, scene, line, settings.band)",
        "line_crossings(paths, scene, line, 20 * settings.band / paths.heights.max(initial=1))",
    ),
    "entries_and_exits_add_up_to_the_change_of_those_within": (
        "tracking/counts/borders.py",
        "np.where(inside(points, zone.corners), 1.0, -1.0)",
        "1.0",
    ),
    "the_time_in_a_zone_is_that_of_its_occupancy": (
        "tracking/counts/zone_tables.py",
        "paths.frames[spans.last] + 1\n",
        "paths.frames[spans.last]\n",
    ),
    "counts_do_not_depend_on_names_or_their_order": (
        "tracking/counts/paths.py",
        "[:-1].clip(max=max(len(ids) - 1, 0))]",
        "[:1]]",
    ),
    "a_straight_way_with_gaps_is_the_whole_way": (
        "tracking/counts/paths.py",
        "filled[gaps] = values[previous] + share",
        "filled[gaps] = values[previous] + 0 * share",
    ),
}
LINKS = {
    "links_do_not_depend_on_the_order_of_tracks": (
        TRANSITS,
        "(seconds > -EARLY)",
        "(seconds > -EARLY) & (np.tri(len(seconds)) > 0)",
    ),
    "links_do_not_depend_on_when_the_clock_began": (
        TRANSITS,
        "max(float(passages.end.max() - passages.begin.min()), 1.0)",
        "max(float(passages.end.max()), 1.0)",
    ),
    "links_lead_to_another_view_and_on_in_time": (TRANSITS, "apart & (seconds > -EARLY)", "apart & (seconds > -20)"),
    "views_may_change_their_names": (
        TRANSITS,
        "passages.view[None] != passages.view[:, None]",
        "passages.view[None] > passages.view[:, None]",
    ),
    "people_are_what_sure_links_join": (
        TRANSITS,
        "(links.earlier[sure], links.later[sure])",
        "(links.earlier[sure], links.earlier[sure])",
    ),
}
FILTERS = {
    "boxes_are_filtered_alike_in_any_unit": (
        KALMAN,
        "return BoxBelief(boxes - remainder * residual,",
        "return BoxBelief(boxes - remainder * np.tanh(residual),",
    ),
    "the_filter_of_boxes_is_the_textbook_filter": (KALMAN, "(t**2 / 4 +", "(t**2 / 3 +"),
    "measurements_of_one_time_may_come_in_any_order": (
        KALMAN,
        "covariance = remainder @ state.covariance @",
        "covariance = remainder @ remainder @ state.covariance @",
    ),
    "a_longer_frame_is_the_same_motion": (KALMAN, "(1.0, longer, longer**2)", "(1.0, longer, longer)"),
    "a_gap_is_predicted_as_frame_by_frame": (KALMAN, "np.maximum(t**2 - 1, 0) / 12", "np.maximum(t**2 - 1, 0) / 6"),
    "weights_sum_to_one_whatever_they_are_multiplied_by": (
        RESAMPLING,
        "np.exp(log_weights - largest)",
        "np.exp(log_weights)",
    ),
    "resampling_is_unbiased": (
        RESAMPLING,
        "np.ceil(count * cumulative - rng",
        "np.ceil(count * cumulative - 0.5 * rng",
    ),
    "the_order_of_particles_does_not_matter": (
        PARTICLES,
        "log_weights = prior + correction +",
        "log_weights = prior[::-1] * np.arange(count) + correction +",
    ),
    "evidence_is_the_mean_likelihood": (
        PARTICLES,
        "log_evidence = log_sum(log_weights)",
        "log_evidence = log_sum(log_weights) + np.log(count)",
    ),
    "moments_move_and_turn_with_the_particles": (
        RESAMPLING,
        "mean[column] = circular_mean(particles[:, column], weights)",
        "pass",
    ),
    "the_share_of_a_likelihood_is_what_particles_bear": (
        RESAMPLING,
        "(middle, high) if enough else (low, middle)",
        "(low, middle) if enough else (middle, high)",
    ),
    "views_that_tell_nothing_change_nothing": (RESAMPLING, "np.log1p(-open_before))", "np.log(open_before))"),
    "a_ball_keeps_its_energy_in_flight_and_loses_its_share_at_a_bounce": (
        "tracking/filters/point_motion.py",
        "moved[:, 2] -= 0.5 * self.gravity",
        "moved[:, 2] -= self.gravity",
    ),
}
FINITE_SETS = {
    "weights_of_the_phd_are_those_of_its_equation": (
        SETS + "phd.py",
        "joint = (detection * weights)[pairs.particle]",
        "joint = weights[pairs.particle]",
    ),
    "the_order_of_measurements_does_not_matter_to_the_phd": (
        SETS + "pairs.py",
        "measurement = np.repeat(chosen, sizes)",
        "measurement = np.repeat(np.minimum(chosen, 0), sizes)",
    ),
    "existence_is_that_of_all_associations": (LABELLED, "missed = 1.0 - r + r * undetected", "missed = r * undetected"),
    "the_order_of_measurements_does_not_matter_to_labels": (
        LABELLED,
        "likelihood[pairs.groups, pairs.measurements] = evidence",
        "likelihood[pairs.groups, pairs.measurements] = evidence * (1 + pairs.measurements)",
    ),
    "what_is_smoothed_lies_between_gone_and_there": (
        LABELLED,
        "existence = np.clip(existence_after + ended, 0.0, 1.0)",
        "existence = np.clip(existence_after - ended, 0.0, 1.0)",
    ),
    "bearings_and_ranges_invert_to_places": (
        SETS + "point_model.py",
        "across = reach * np.cos(elevation)",
        "across = reach",
    ),
    "angles_differ_the_shortest_way_round": (
        SETS + "point_model.py",
        "(apart[column] + np.pi) % (2 * np.pi) - np.pi",
        "apart[column] % (2 * np.pi)",
    ),
}
KERNELS = {
    "a_shifted_window_answers_shifted": (
        CORRELATION,
        "windows.spectra * templates.spectra.conj()",
        "windows.spectra.conj() * templates.spectra",
    ),
    "the_kernel_is_that_of_all_shifts": (CORRELATION, "- 2 * cross\n", "- cross\n"),
    "a_blended_template_is_that_of_the_blended_windows": (
        CORRELATION,
        "total = 2 * columns.sum(axis=1) - columns[:, 0]",
        "total = 2 * columns.sum(axis=1)",
    ),
    "filters_of_a_bank_answer_as_each_alone": (
        CORRELATION,
        "coefficients = np.concatenate([bank.coefficients for bank in banks])",
        "coefficients = np.concatenate([bank.coefficients for bank in banks[::-1]])",
    ),
    "a_support_cuts_what_its_mask_cuts": (
        CORRELATION,
        "row <= height / 2, column <= width / 2",
        "row <= height / 2, column < width",
    ),
    "a_learnt_filter_lives_on_its_target_and_follows_it": (CORRELATION, "    return masked\n", "    return filters\n"),
    "a_scale_filter_finds_the_size_that_it_learnt": (
        "tracking/filters/scale_filter.py",
        "numerator = spectrum.conj() *",
        "numerator = spectrum *",
    ),
}
SHAPES = {
    "contours_move_and_turn_with_the_state[goldfish]": (
        BODY,
        "turned = np.stack([-basis[..., 1], basis[..., 0]]",
        "turned = np.stack([basis[..., 1], basis[..., 0]]",
    ),
    "a_goldfish_bends_alike_to_both_sides": (BODY, "np.cos(phi), np.sin(phi)]", "np.cos(phi), np.abs(np.sin(phi))]"),
    "a_squashed_ball_keeps_its_area": (
        BODY,
        "np.concatenate([length, 1 / length]",
        "np.concatenate([length, 2 - length]",
    ),
    "points_of_an_ellipse_lie_on_it_evenly": (
        BODY,
        "at = np.interp(np.arange(points) * way[-1] / points, way, fine)",
        "at = np.arange(points) * 2 * np.pi / points",
    ),
    "a_body_is_learnt_from_shapes_and_not_from_places": (LEARN, "turns + heading\n", "turns\n"),
    "bends_are_principal_components": (LEARN, "turns = turns + turn\n", "turns = turn\n"),
    "lines_are_lined_up_by_their_turn_and_first_point": (
        LEARN,
        "slide = np.abs(correlation).argmax",
        "slide = correlation.real.argmax",
    ),
}
FILES = {
    "motchallenge_results_come_back": (MOT, "xywh[:, :2] -= 1", "xywh[:, :2] -= 0"),
    "motchallenge_labels_come_back": (MOT, "np.clip(rows[:, 8], 0, 1)", "np.clip(rows[:, 8], 0, 2)"),
    "motchallenge_detections_come_back": (
        MOT,
        'f"{frame + 1},-1,{box},{score:.6f}',
        'f"{frame + 1},-1,{box},{score:.1f}',
    ),
    "files_of_annotation_tools_come_back[coco]": (
        FORMATS + "coco.py",
        "corners = with_area((x, y, x + width, y + height))",
        "corners = with_area((x, y, width, height))",
    ),
    "files_of_annotation_tools_come_back[cvat]": (
        FORMATS + "cvat.py",
        "next_frame < video.frame_count:",
        "next_frame < 0:",
    ),
    "files_of_annotation_tools_come_back[label-studio]": (
        FORMATS + "label_studio.py",
        '"enabled": k not in ends',
        '"enabled": True',
    ),
    "files_of_annotation_tools_come_back[yolo]": (
        FORMATS + "yolo.py",
        "return int(number[0]) - first",
        "return int(number[0])",
    ),
    "names_come_back_in_any_script[.csv]": (
        FORMATS + "rows.py",
        "for sign in inside if sign in heading)",
        "for sign in inside)",
    ),
    "results_come_back_to_the_last_bit[.csv]": (
        TABLES,
        'name: column + 1 if name == "frame"',
        'name: column if name == "frame"',
    ),
    "results_come_back_to_the_last_bit[.json]": (
        TABLES,
        'content["columns"].items()}, content[KNOWN]',
        'content["columns"].items()}, {}',
    ),
    "kittis_labels_come_back": (FORMATS + "box_labels.py", "rows[:, 2:6], counted", "rows[:, 3:7], counted"),
    "okutamas_labels_come_back": (FORMATS + "okutama.py", "np.ceil(scaled[:, 2:])", "np.floor(scaled[:, 2:])"),
    "what_people_do_comes_back": (FORMATS + "acting_tracks.py", "(track.frames + 1).tolist()", "track.frames.tolist()"),
    "boxes_of_one_target_come_back": (
        FORMATS + "single.py",
        "boxes = corners_from_xywh(values - [1, 1, 0, 0])",
        "boxes = corners_from_xywh(values - [1, 1, 1, 1])",
    ),
    "turned_boxes_come_back": (
        FORMATS + "rotated.py",
        "round(float(np.degrees(box[4])), 4)",
        "round(float(box[4]), 4)",
    ),
    "points_and_their_tracks_come_back": (
        FORMATS + "measurement_tables.py",
        '{"frame": rows.frames + 1, "id": rows.ids',
        '{"frame": rows.frames + 2, "id": rows.ids',
    ),
    "what_a_sequence_says_of_itself_comes_back": (
        FORMATS + "mot_sequence.py",
        'f"imWidth={width}", f"imHeight={height}"',
        'f"imWidth={height}", f"imHeight={width}"',
    ),
    "corrections_come_back_in_any_portions": (FORMATS + "correction_log.py", "self.undone[:-1])", "self.undone)"),
}
MORE_FILES = {
    "states_of_bodies_come_back": (FORMATS + "body_states.py", 'table | {"frame": table["frame"] + 1}', "table"),
    "points_of_animals_come_back[sleap.csv]": (
        FORMATS + "body_points.py",
        '(".x", ".y", ".score")',
        '(".y", ".x", ".score")',
    ),
    "points_of_animals_come_back[dlc.csv]": (
        FORMATS + "body_points.py",
        "np.repeat(frames, len(names))",
        "np.tile(frames, len(names))",
    ),
    "points_of_animals_come_back[h5]": (FORMATS + "sleap_hdf5.py", "data=values.T,", "data=values,"),
    "points_of_animals_come_back[slp]": (
        FORMATS + "sleap_hdf5.py",
        "k * count, (k + 1) * count, 0.0)",
        "k, k + count, 0.0)",
    ),
    "positions_in_space_come_back[.csv]": (
        TABLES,
        "covariances[:, a, b] = covariances[:, b, a] = table[name]",
        "covariances[:, a, b] = table[name]",
    ),
    "sensed_targets_come_back": (
        TABLES,
        "covariances[:, row, column] = covariances[:, column, row] = part[name]",
        "covariances[:, row, column] = part[name]",
    ),
    "cameras_come_back": ("tracking/cameras/camera_files.py", '"offset": float(placed.offset),', '"offset": 0.0,'),
    "lenses_of_ocamcalib_come_back[ocam]": (
        "tracking/cameras/lens_files.py",
        "np.array([column, row]) + HALF_PIXEL",
        "np.array([column, row])",
    ),
    "lenses_of_ocamcalib_come_back[py-ocam]": (
        "tracking/cameras/lens_files.py",
        '(lens.centre - HALF_PIXEL).tolist(),\n        "stretch',
        'lens.centre.tolist(),\n        "stretch',
    ),
    "intrinsics_come_back": (
        "tracking/cameras/lens_files.py",
        "camera.principal_point - HALF_PIXEL",
        "camera.principal_point",
    ),
    "learnt_bodies_come_back": (
        BODY,
        '("mean", "modes", "curves", "bends")]\n        return',
        '("mean", "curves", "modes", "bends")]\n        return',
    ),
    "scenes_come_back": ("tracking/counts/scene.py", '"from": start, "to": end', '"from": end, "to": start'),
    "networks_come_back": ("tracking/association/solved_network.py", "table[name] / SCALE", "table[name] * SCALE"),
}
BY_FILE = {
    "metrics": METRICS,
    "flow": FLOWS,
    "trackers": TRACKERS,
    "geometry": BOXES,
    "cameras": CAMERAS,
    "counts": COUNTS,
    "linking": LINKS,
    "filters": FILTERS,
    "finite_sets": FINITE_SETS,
    "correlation": KERNELS,
    "shapes": SHAPES,
    "round_trips": FILES,
    "more_round_trips": MORE_FILES,
}


def of_file(name: str) -> list[Fault]:
    """The faults of the properties in ``test_NAME.py``."""
    return [Fault(*change, f"tests/properties/test_{name}.py::test_{test}") for test, change in BY_FILE[name].items()]
