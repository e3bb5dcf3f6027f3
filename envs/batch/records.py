"""The records of a batch: what compiled kernels read and write, and the read-only view of it that is public."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Fields = list[tuple[Any, ...]]
Records = NDArray[np.void]

PRIVATE = ("space", "ground", "links", "joints", "extra_body", "table", "env_index")
"""Fields with addresses, and the place in the batch. They come last in a record and are in no public view: a wrong
address would end the process."""


def make_records(count: int, fields: Fields) -> Records:
    """An array of records, zeroed, whose fields with addresses come last."""
    ordered = sorted(fields, key=lambda field: field[0] in PRIVATE)
    return np.zeros(count, np.dtype(ordered, align=True))


def public_bytes(records: Records) -> int:
    """How many bytes of a record come before its addresses."""
    places = [place for name, (_, place, *_) in (records.dtype.fields or {}).items() if name in PRIVATE]
    return min(places, default=records.itemsize)


def public_view(records: Records) -> Records:
    """The records without their addresses, as an array that cannot be written to or be made writeable."""
    fields = {name: entry for name, entry in (records.dtype.fields or {}).items() if name not in PRIVATE}
    layout: Any = {
        "names": list(fields),
        "formats": [entry[0] for entry in fields.values()],
        "offsets": [entry[1] for entry in fields.values()],
        "itemsize": records.itemsize,
    }
    memory = records.view(np.uint8).reshape(-1).data.toreadonly()
    return np.frombuffer(memory, np.dtype(layout, align=True))
