"""`tsuiseki models`: networks listed, and those of other projects fetched."""

from __future__ import annotations

import sys

from tsuiseki.tracking.errors import RequestError


def list_models() -> int:
    """List all networks: size, licence, time, average precision."""
    from tsuiseki.tracking.weights.listing import table

    print(table())
    return 0


def get(name: str, *, yes: bool = False) -> int:
    """Download a model of the catalogue into the user's cache, for --detector NAME or --appearance NAME.

    What the model learnt from is printed first. A download that was cut off goes on where it ended.

    Args:
        name: of the model, as tsuiseki models list has it.
        yes: do not ask.
    """
    from tsuiseki.tracking.onnx import card_of
    from tsuiseki.tracking.runs.progress import progress
    from tsuiseki.tracking.weights import shipped, shipped_names
    from tsuiseki.tracking.weights.catalogue import OPTIONS, find_model, model_named
    from tsuiseki.tracking.weights.download import download

    ships = [whole for whole in shipped_names() if name in (whole, whole.partition("_")[2])]
    if find_model(name) is None and ships:
        print(f"{name} ships with tsuiseki; take it by its name")
        for file in (file for file in map(shipped, ships) if file.suffix == ".onnx"):
            print(f"{file.stem} learnt from: {card_of(file).training_data}")
        return 0
    entry = model_named(name)
    print(entry)
    try:
        print(f"it is there already: {entry.checked()}")
        return 0
    except RequestError:
        pass
    if not yes:
        if not sys.stdin.isatty():
            raise RequestError("expected a terminal to ask whether to download it, got none; give `yes`")
        if input(f"Download it to {entry.file}? [y/N] ").strip().lower() not in ("y", "yes"):
            print("nothing was downloaded")
            return 0
    verified = bool(entry.sha256 or entry.record())
    download(entry, progress)
    note = "" if verified else "; this sum is not verified: compare it with the project's"
    print(f"{entry.file}, sha256 {entry.record()['sha256']}{note}")
    print(f"Use it by {OPTIONS[entry.kind]} {name}.")
    return 0
