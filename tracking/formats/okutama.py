"""Okutama-Action label files: who is where in each frame of a drone's video, and what each is doing.

A row is ``track_id xmin ymin xmax ymax frame lost occluded generated "Person" "Action1" "Action2" …``, separated by
spaces, with zero to four actions. Frames count from 0. Coordinates are those of 3840x2160 video also where the frames
are the 1280x720 ones that come with the data. Only ``SingleActionTrackingLabels`` keep a person's id through a video;
in ``MultiActionLabels`` everybody gets another one every 180 frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.label_checks import LabelFile, Sieve
from tsuiseki.tracking.formats.mot_sequence import MotSequence, image_size, list_images
from tsuiseki.tracking.formats.rows import read_rows, repeated, rows_of
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.types import BoolArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME, FrameRange
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth

# Width and height of the video that labels are in, pixels.
LABEL_SIZE = (3840, 2160)
# Where such labels lie in a MOTChallenge sequence.
ACTIONS_FILE = "gt/actions.txt"
Protocol = Literal["published", "lenient"]
# As the label files spell what the thesis calls otherwise.
FILE_NAMES = {"Handshaking": "Hand Shaking"}
_SPELLINGS = {name.replace(" ", "").lower(): name for name in OKUTAMA_ACTIONS}


def read_okutama(path: str | Path, size: tuple[int, int]) -> ActionLabels:
    """The labels in the file at ``path``, in pixels of frames of ``size``, width and height.

    Raises:
        RequestError: the file is missing or malformed, quotes are missing, an action is unknown, most boxes that are
            not lost lie outside the frame, or an id stands twice in a frame.
    """
    path = Path(path)
    rows = read_rows(path, "Okutama-Action labels").without_heading(9)
    if not rows.cells:
        raise RequestError(f"{path} is empty: expected rows of labels")
    for k, cells in enumerate(rows.cells):
        if complaint := _complaint(cells, rows.texts[k]):
            raise rows.error(k, complaint)
    numbers = np.array([cells[:9] for cells in rows.cells], dtype=np.float64)
    ids = rows.whole_numbers("track_id", 0, first=0)
    frames = rows.whole_numbers("frame", 5, 0, LAST_FRAME - 1)
    names = [
        [_action_name(name, f"{path}:{line}") for name in cells[10:]]
        for line, cells in zip(rows.lines, rows.cells, strict=True)
    ]
    lost, occluded, generated = (numbers[:, column] == 1 for column in (6, 7, 8))
    boxes = clip_boxes(numbers[:, 1:5] * np.tile(np.array(size) / LABEL_SIZE, 2), *size)
    width, height = LABEL_SIZE
    sieve = Sieve(path, "rows")
    outside = ~lost & (areas(boxes) <= 0), f"without an area in {width}x{height}, and not lost"
    usable = sieve.usable([f"line {line}" for line in rows.lines], outside)
    sieve.tell()
    present = np.flatnonzero(~lost & usable)
    if (row := repeated(frames[present], ids[present])) is not None:
        k = present[row]
        raise RequestError(f"{path}:{rows.lines[k]}: id {ids[k]} stands twice in frame {frames[k]}")
    boxes[lost] = 0.0, 0.0, 1.0, 1.0
    labels = ActionLabels(frames, ids, boxes, lost, occluded, generated, actions_of(names), OKUTAMA_ACTIONS)
    return labels if usable.all() else labels.select(usable)


def _complaint(cells: list[str], text: str) -> str:
    """What a row that does not fit should have; empty where it fits."""
    try:
        numbers = np.array(cells[:9], dtype=np.float64)
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) < 9 or not np.isfinite(numbers).all():
        return 'track_id xmin ymin xmax ymax frame lost occluded generated "Person" "Action" …'
    if any(flag not in ("0", "1") for flag in cells[6:9]):
        return "lost, occluded and generated as 0 or 1, then names in double quotes"
    if text.count('"') < 2 * len(cells[9:]):
        return 'names in double quotes, as "Person" "Walking"'
    return ""


def _action_name(name: str, place: str) -> str:
    spelling = _SPELLINGS.get(name.replace(" ", "").lower(), name)
    if spelling not in OKUTAMA_ACTIONS:
        raise RequestError(f"{place}: unknown action {name!r}; known are {', '.join(OKUTAMA_ACTIONS)}")
    return spelling


def write_okutama(path: Path, labels: ActionLabels, size: tuple[int, int]) -> None:
    """Write ``labels``, whose boxes are in pixels of frames of ``size`` (width, height)."""
    scaled = labels.boxes * np.tile(np.array(LABEL_SIZE) / size, 2)
    low, high = np.floor(scaled[:, :2]).astype(int), np.ceil(scaled[:, 2:]).astype(int)
    rows = []
    for k in range(len(labels)):
        flags = " ".join(str(int(f[k])) for f in (labels.lost, labels.occluded, labels.generated))
        names = [n for n, there in zip(labels.class_names, labels.actions[k], strict=True) if there]
        quoted = " ".join(f'"{FILE_NAMES.get(n, n)}"' for n in ("Person", *names))
        rows.append(
            f"{labels.ids[k]} {low[k, 0]} {low[k, 1]} {high[k, 0]} {high[k, 1]} {labels.frames[k]} {flags} {quoted}\n"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(rows), encoding="utf-8")


def actions_of(names: Sequence[Sequence[str]], class_names: tuple[str, ...] = OKUTAMA_ACTIONS) -> BoolArray:
    """``(N, C)`` from the names of each row's actions."""
    result = np.zeros((len(names), len(class_names)), dtype=np.bool_)
    for k, row in enumerate(names):
        for name in row:
            result[k, class_names.index(name)] = True
    return result


def okutama_truth(labels: ActionLabels, protocol: Protocol) -> tuple[GroundTruth, BoolArray]:
    """What results are scored against, ordered by frame, and the actions ``(N, C)`` of its rows.

    ``published``: lost and occluded rows are removed, and so is frame 0, as in the numbers that are published with the
    data; a result on a removed row is a false alarm, and results before `counted_from` are passed over. ``lenient``:
    lost rows are removed, a result on an occluded one is neither right nor wrong, and all frames count. Both match from
    an IoU of 0.5 on.
    """
    counted = ~labels.lost & (labels.frames >= counted_from(protocol).first)
    if protocol == "published":
        counted &= ~labels.occluded
    chosen = labels.select(np.flatnonzero(counted)[np.argsort(labels.frames[counted], kind="stable")])
    truth = GroundTruth(
        frames=chosen.frames,
        ids=chosen.ids,
        boxes=chosen.boxes,
        evaluated=~chosen.occluded,
        ignored=chosen.occluded,
        visibility=np.where(chosen.occluded, 0.3, 1.0),
    )
    return truth, chosen.actions


def counted_from(protocol: Protocol) -> FrameRange:
    """The frames that count: the published numbers leave out the first."""
    return FrameRange(1 if protocol == "published" else 0)


LABEL_FOLDERS = ("SingleActionTrackingLabels", "MultiActionLabels")
# Width and height of the frames that come with the data, pixels.
EXTRACTED_SIZE = (1280, 720)
ADVICE = "use the frames that come with the data, Extracted-Frames-1280x720"


def is_okutama(folder: Path) -> bool:
    """Whether ``folder`` has Okutama-Action's layout; MOTChallenge sequences beside a folder Labels do not."""
    return any((folder / "Labels" / kind).is_dir() for kind in LABEL_FOLDERS)


def is_okutama_file(path: Path) -> bool:
    """Whether ``path`` is a label file: what stands in the tenth column is a word, as in no other format here."""
    (cells, *_) = rows_of(read_text(path, "labels")[:4000], path).cells or [[]]
    return len(cells) > 9 and cells[9][:1].isalpha()


def read_clip_labels(clip: MotSequence, size: tuple[int, int] | None = None) -> ActionLabels:
    """The labels in ``gt/actions.txt`` of a generated clip, in pixels of its frames; of ``size`` where it does not say.

    Raises:
        RequestError: labels are missing or broken (see `read_okutama`), or nothing says how large the frames are.
    """
    size = (clip.width, clip.height) if clip.width and clip.height else size
    if size is None:
        raise RequestError(f"{clip.folder}/seqinfo.ini: expected imWidth and imHeight, to scale {ACTIONS_FILE} to them")
    return read_okutama(clip.folder / ACTIONS_FILE, size)


def find_okutama(folder: str | Path) -> list[LabelFile]:
    """The videos of Okutama-Action at ``folder``, or of a generated clip, or of a folder of generated clips, by name.

    Raises:
        RequestError: the layout is another, or frames are missing between others.
    """
    folder = Path(folder)
    if not is_okutama(folder):
        clips = [folder] if (folder / ACTIONS_FILE).is_file() else sorted(folder.glob("*/"))
        clips = [clip for clip in clips if (clip / ACTIONS_FILE).is_file()]
        videos = [LabelFile(clip.name, list_images(clip / "img1"), clip / ACTIONS_FILE) for clip in clips]
    else:
        # Walking through the folders takes a while where there are a hundred thousand frames: once for all videos.
        # Of frames in several sizes the 1280x720 ones come last, and stay.
        frame_folders = sorted(folder.glob("**/Extracted-Frames-*/*"), key=str, reverse=True)
        places = {place.name: place for place in frame_folders if place.is_dir()}
        kinds = (sorted((folder / "Labels" / kind).glob("*/*.txt")) for kind in LABEL_FOLDERS)
        videos = [_published(labels, places.get(labels.stem)) for labels in next(filter(None, kinds), [])]
    if not videos:
        raise RequestError(
            f"expected Labels/ and Drone1/…/Extracted-Frames-1280x720/ of Okutama-Action in {folder}, or generated "
            f"clips with {ACTIONS_FILE}; found neither"
        )
    return videos


def read_okutama_video(video: LabelFile, size: tuple[int, int] | None = None) -> ActionLabels:
    """The labels of a video, in pixels of a size: by default of its frames, or without any of `EXTRACTED_SIZE`.

    Raises:
        RequestError: labels are broken (see `read_okutama`), or frames and labels do not match.
    """
    if not video.images:
        return read_okutama(video.labels, size or EXTRACTED_SIZE)
    frame_size = image_size(video.images[0])
    labels = read_okutama(video.labels, size or frame_size)
    check_frames(labels, len(video.images), frame_size, str(video.labels))
    return labels


def check_frames(labels: ActionLabels, length: int, size: tuple[int, int], name: str) -> None:
    """Refuse a video whose frames the labels cannot belong to.

    Raises:
        RequestError: labels reach beyond the video, the aspect ratio is another, or it is one of Okutama's 4K videos,
            which its labels do not line up with.
    """
    last = int(labels.frames.max())
    if last >= length:
        raise RequestError(f"{name}: labels reach frame {last}, but the video ends with frame {length - 1}; {ADVICE}")
    if abs(size[0] * LABEL_SIZE[1] - size[1] * LABEL_SIZE[0]) > 0.01 * size[1] * LABEL_SIZE[0]:
        raise RequestError(
            f"{name}: expected frames of the aspect 16:9 of the labels, got {size[0]}x{size[1]}; {ADVICE}"
        )
    if size == LABEL_SIZE and length != last + 1:
        raise RequestError(
            f"{name}: the 3840x2160 video has {length} frames, the labels {last + 1}: Okutama's 4K videos and its "
            f"labels do not line up; {ADVICE}"
        )


def _published(labels: Path, frames: Path | None) -> LabelFile:
    """The video of a label file, with its frames where they are there; their names are their numbers, from 0."""
    images = () if frames is None else list_images(frames)
    for number, image in enumerate(images):
        if image.stem.isdecimal() and int(image.stem) != number:
            raise RequestError(
                f"{image.parent}: expected frames numbered 0 to {len(images) - 1}, found no frame {number}; "
                "labels would not line up"
            )
    return LabelFile(labels.stem, images, labels)
