"""The records of a batch: what compiled kernels read and write, and the read-only view of it that is public."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

Fields = list[tuple[Any, ...]]
Records = NDArray[np.void]

PRIVATE = ("space", "ground", "links", "joints", "table", "env_index")
"""Fields with addresses, and the place in the batch. They come first in a record and are in no public view: a wrong
address would end the process."""

KERNELS = "_kernel"
"""How the names of the fields of a model record end that have addresses of compiled functions; not public either."""


def make_records(count: int, fields: Fields) -> Records:
    """An array of records, zeroed, whose fields with addresses come first."""
    ordered = sorted(fields, key=lambda field: field[0] not in PRIVATE)
    kind = np.dtype(ordered, align=True)
    try:
        return np.zeros(count, kind)
    except (MemoryError, ValueError):  # the second for numbers beyond what an array may have
        size = count * kind.itemsize / 2**30
        raise MemoryError(f"{count} environments need {size:.4g} GiB, more than there is: ask for fewer") from None


def address_of_first(memory: NDArray[Any] | bytes) -> int:
    """The address of the first byte."""
    array = np.frombuffer(memory, np.uint8) if isinstance(memory, bytes) else memory
    return int(array.ctypes.data)


def first_public_byte(records: Records) -> int:
    """How many bytes of a record its addresses take."""
    return min(place for name, (_, place, *_) in (records.dtype.fields or {}).items() if name not in PRIVATE)


def public_view(records: Records) -> Records:
    """The records without their addresses, as an array that cannot be written to or be made writeable."""
    every = (records.dtype.fields or {}).items()
    fields = {name: entry for name, entry in every if name not in PRIVATE and not name.endswith(KERNELS)}
    layout: Any = {
        "names": list(fields),
        "formats": [entry[0] for entry in fields.values()],
        "offsets": [entry[1] for entry in fields.values()],
        "itemsize": records.itemsize,
    }
    memory = records.view(np.uint8).reshape(-1).data.toreadonly()
    return np.frombuffer(memory, np.dtype(layout, align=True))


_CODES = {"f": "d", "i": "q", "b": "?"}
"""How `struct` names the kinds of numbers in a record."""


def reader(records: Records, env_index: int, names: tuple[str, ...]) -> Callable[[], tuple[Any, ...]]:
    """Reads the numbers of some fields of one record, in the order in which they lie there, as one flat tuple.

    This takes a tenth of the time of reading them from a NumPy record one by one.

    Raises:
        ValueError: if the names are in another order.
    """
    fields: Any = records.dtype.fields
    form, end = "=", 0
    for name in names:
        kind, place, *_ = fields[name]
        if place < end:
            raise ValueError(f"{name} lies before the fields named before it; the order is {records.dtype.names}")
        count = int(np.prod(kind.shape))
        form += f"{place - end}x{count}{_CODES[kind.base.kind]}"
        end = place + kind.itemsize
    memory = records.view(np.uint8).reshape(len(records), -1)[env_index].data
    return partial(Struct(form).unpack_from, memory)
