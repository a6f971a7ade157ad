"""Reproduction of a list of published values."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from .compared import Erratum, Reproduction
from .computing import Computing
from .listed import listed


def reproduce(
    folder: str | os.PathLike[str], page: str | os.PathLike[str] | None = None, pictures: str = ""
) -> Reproduction:
    """Run all entries of `published.toml` of a folder. `pictures`: "svg" or "png" are drawn beside a `page`, which is not written here.

    Raises `UsageError` for an invalid list, and as `Model.run`.
    """
    place = Path(folder)
    found = listed(place)
    computing = Computing(place)
    values = tuple(v for entry in found.get("value", ()) for v in computing.values(entry))
    tables = (
        *(computing.table(entry) for entry in found.get("table", ())),
        *(computing.inversion(entry) for entry in found.get("inversion", ())),
    )
    errata = tuple(Erratum(e["where"], e["text"]) for e in found.get("erratum", ()))
    title, source = str(found.get("title", place.name)), str(found.get("source", ""))
    made = Reproduction(title, source, values, errata, tables)
    if page is None or not pictures:
        return made
    from .pictures import draw_all

    return replace(made, pictures=draw_all(computing, found.get("picture", ()), Path(page), pictures))
