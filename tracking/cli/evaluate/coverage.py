"""`tsuiseki evaluate coverage`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Comparison, Stretch
from tsuiseki.tracking.errors import RequestError


def coverage(given: Comparison, stretch: Stretch, overlap: float = 0.5) -> None:
    """Say how well tracks of many follow the one person who is labelled: share of frames, switches of identity.

    Args:
        truth: a sequence folder with one labelled target (OTB, VOT, UAV123), a folder of them, or a folder of label
            files NAME.txt.
        results: MOTChallenge text files, or folders that hold NAME.txt or NAME/tracks.txt for each sequence NAME
            (for a single sequence also tracks.txt), as `track people` and `track drone` write them; several are
            compared.
        overlap: of boxes from which a track is on the target.
    """
    from tsuiseki.tracking.evaluation.target_coverage import cover_targets, coverage_table, coverage_values
    from tsuiseki.tracking.formats.single import find_single_sequences

    if not 0 < overlap <= 1:
        raise RequestError(f"`overlap`: expected a share above 0 and at most 1, got {overlap:g}")
    sequences = find_single_sequences(given.truth)
    found = {name: cover_targets(sequences, path, overlap, stretch.range) for name, path in given.named().items()}
    given.report(coverage_table(found), coverage_values(found))
