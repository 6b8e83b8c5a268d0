"""Pages from the templates beside this file: a page looks as its one template says, and text from inputs is escaped.

`parts.html.j2` has what several pages share. A picture ``(H, W, 3)`` uint8 RGB becomes its place by ``| jpeg``, a
figure by ``| svg(name)``, a video by ``| video``, a setting or fact its text by ``| words``.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from functools import cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import cv2

from tsuiseki.tracking.report.plots import inline_svg
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video.webm import video_type

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"
# Bytes of the largest video inside a page; a larger one lies beside it.
MOST_EMBEDDED = 8_000_000
# Of JPEG, in [0, 100].
QUALITY = 85


def render(template: str, **values: Any) -> str:
    """The HTML of a template, by the name of its file, with these values."""
    # A name of a file need not be text.
    return _environment().get_template(template).render(values).encode("utf-8", "replace").decode("utf-8")


def section(template: str, **values: Any) -> Markup:
    """The HTML of a part of a page, which other templates take as it is.

    Args:
        template: a template of one's own, as text; it may import ``parts.html.j2``.
        values: for it.
    """
    from markupsafe import Markup

    return Markup(_environment().from_string(template).render(values))


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(TEMPLATES)
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"jpeg": jpeg_place, "svg": inline_svg, "video": video_place, "words": words}
    return environment


def words(value: Any) -> str:
    """A value of a setting or fact as people write it; empty for None and for what holds nothing."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name.replace('_', ' ')} {text}" for name, inner in value.items() if (text := words(inner)))
    if isinstance(value, list | tuple):
        return ", ".join(text for inner in value if (text := words(inner)))
    return str(value)


def jpeg_place(image: ImageArray) -> str:
    """The address of an image ``(H, W, 3)`` uint8 RGB that holds the image itself."""
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}"


def video_place(path: Path, inside: str = "") -> str:
    """The address of a video: with the video itself, or beside the page where it is above `MOST_EMBEDDED`.

    Args:
        path: of the video.
        inside: folder beside the page in which it lies; by default that of the page.
    """
    if path.stat().st_size > MOST_EMBEDDED:
        return quote(str(PurePosixPath(inside, path.name)))
    return f"data:{video_type(path)};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def overlay_in(folder: Path, name: str = "overlay") -> Path | None:
    """The video that a run has drawn into its folder; None where none lies there."""
    return next(iter(sorted(folder.glob(f"{name}.*"))), None)
