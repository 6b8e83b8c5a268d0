"""How a run is watched: the options, and the observers that they ask for."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import Options
from tsuiseki.tracking.runs.messages import complain

if TYPE_CHECKING:
    from tsuiseki.tracking.counts.scene import Scene
    from tsuiseki.tracking.types.live import Observer
    from tsuiseki.tracking.video.frame_source import Source


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Watching(Options):
    """How the run is watched.

    Attributes:
        events: send events to -, a file, or an address http://… or mqtt://….
        scene: YAML of lines and zones for events; tsuiseki scene draws it.
    """

    events: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    scene: Path | None = None

    def __post_init__(self) -> None:
        if self.scene is not None and not self.wanted:
            raise RequestError("expected `scene` with `events`, got it alone; tsuiseki count takes it, too")

    @property
    def wanted(self) -> bool:
        """Whether the run is watched at all."""
        return self.events is not None

    @contextmanager
    def own_output(self) -> Iterator[None]:
        """Where events go to the program's output, nothing else does within the ``with`` block."""
        with redirect_stdout(sys.stderr) if self.events == "-" else nullcontext():
            yield

    @contextmanager
    def observers(self, out: Path, sources: Sequence[Source]) -> Iterator[list[Observer]]:
        """What watches a run whose result goes to the folder ``out``; it ends with the ``with`` block.

        Raises:
            RequestError: a receiver or the scene cannot be used.
        """
        from tsuiseki.tracking.events.observer import EventObserver

        scene = self._scene(sources)
        with ExitStack() as stack:
            observers: list[Observer] = []
            if self.events is not None:
                recorded = not any(source.live for source in sources)
                events = EventObserver.open(self.events, out, complain, scene, recorded)
                stack.callback(events.close)
                observers.append(events)
            yield observers

    def _scene(self, sources: Sequence[Source]) -> Scene | None:
        from tsuiseki.tracking.counts.scene import read_scene

        if self.scene is None:
            return None
        scene = read_scene(self.scene)
        for source in sources:
            scene.check_video(source.size, str(self.scene))
        return scene
