"""Minari datasets as files: written whole or not at all, and read without running code."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType
from typing import Any, Self

from gymnasium.error import DependencyNotInstalled

from planners.checks import brief
from planners.documents import read_document

DETAILS = "planarm"
"""Key of the metadata below which planarm writes how a dataset was recorded."""

_DRAFT = ".planarm-"  # folders that begin with it belong to the process whose number follows
_REPLACED = "replaced"  # in a draft: the data in whose place those of the draft are to be
_MOST_METADATA = 1 << 24  # bytes


def minari() -> Any:
    """The library Minari; a DependencyNotInstalled says how to install it if it is missing."""
    try:
        import h5py  # noqa: F401
        import minari
    except ModuleNotFoundError as error:
        raise DependencyNotInstalled(f'datasets need {error.name}; run: pip install "planarm[data]"') from None
    return minari


def dataset_folder(dataset: str) -> Path:
    """The folder of a dataset to read, by its path or by its id; raises as `folder_of_id`."""
    return Path(dataset) if Path(dataset).is_dir() else folder_of_id(dataset)


def folder_of_id(dataset_id: str) -> Path:
    """The folder below Minari's that an id stands for.

    Raises:
        ValueError: if the id is not of the form ``(namespace/)name-v0``.
    """
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage import get_dataset_path

    try:
        parse_dataset_id(dataset_id)
    except (ValueError, TypeError):  # a TypeError for a name without a version
        raise ValueError(
            f"dataset {brief(dataset_id)} is no folder and no id such as belt/dpct-v0: letters, digits, - and _ with a "
            "version at the end; a namespace has at least two characters"
        ) from None
    return Path(get_dataset_path(dataset_id))


def raw_file(path: Path) -> io.FileIO:
    """A file that is there, to read and to write without a buffer."""
    return io.FileIO(path, "r+")


class _File:
    """A file that HDF5 writes, which ends the process where a write fails: what does not fit goes on in memory.

    Attributes:
        error: of the first write that failed; the file is then of no use.
    """

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        self._path = path
        self._file: io.RawIOBase | io.BytesIO = raw_file(path)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def write(self, content: Any) -> int:
        """Write all, here or in memory."""
        view, start, written = memoryview(content).cast("B"), self._file.tell(), 0
        try:
            while written < len(view):
                written += self._file.write(view[written:]) or 0
        except OSError as error:
            self._go_on_in_memory(error)
            self._file.seek(start)
            self._file.write(view)
        return len(view)

    def truncate(self, size: int) -> int:
        """Change the size, here or in memory."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._go_on_in_memory(error)
            return size

    def _go_on_in_memory(self, error: OSError) -> None:
        self.error = OSError(error.errno, error.strerror, str(self._path))
        self._file.close()
        self._file = io.BytesIO(self._path.read_bytes())


class Draft:
    """A dataset that is being written, in a folder beside the others; it becomes a dataset when it is finished.

    A context: what is not finished at its end is deleted. What a killed process has left is deleted by the next draft.

    Args:
        dataset_id: ``(namespace/)name-v0``.
        env: of which the episodes are; its spec is stored.
        overwrite: whether a dataset of this id may be replaced.

    Raises:
        ValueError: if the id is malformed, there is such a dataset, or the folder is inside or around another one's.
    """

    def __init__(self, dataset_id: str, env: Any, *, overwrite: bool = False) -> None:
        minari()
        from minari.dataset.minari_storage import MinariStorage

        self.dataset_id, self.folder = dataset_id, folder_of_id(dataset_id)
        root = self.folder.parents[len(Path(dataset_id).parts) - 1]
        _require_apart(dataset_id, root)
        root.mkdir(parents=True, exist_ok=True)
        _tidy(root)
        if (self.folder / "data").exists() and not overwrite:
            raise ValueError(
                f"there is a dataset {dataset_id} in {self.folder}: give another id, or --overwrite (overwrite=True)"
            )
        self._draft = Path(mkdtemp(prefix=f"{_DRAFT}{os.getpid()}-", dir=root))
        with ExitStack() as on_failure:
            on_failure.callback(shutil.rmtree, self._draft, ignore_errors=True)
            with _naming(self._draft):
                self._storage: Any = MinariStorage.new(
                    self._draft / "data", env.observation_space, env.action_space, env_spec=env.spec
                )
                self._file = self._storage._file_path = _File(self._storage._file_path)
            on_failure.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._file.close()
        _delete(self._draft)

    def add(self, episodes: Sequence[Any], details: Sequence[Mapping[str, Any]]) -> None:
        """Append episodes (``minari.data_collector.EpisodeBuffer``), each with metadata of its own."""
        with _naming(self._draft):
            first = self._storage.total_episodes
            self._storage.update_episodes(episodes)
            self._check()
            self._storage.update_episode_metadata(map(dict, details), range(first, first + len(episodes)))
            self._check()

    def _check(self) -> None:
        if self._file.error is not None:
            raise self._file.error

    def finish(self, metadata: Mapping[str, Any]) -> Path:
        """Make it a dataset, with metadata, and its namespace if that is new; the folder of the dataset."""
        from minari.namespace import create_namespace, list_local_namespaces

        with _naming(self._draft):
            self._storage.update_metadata(
                {"dataset_id": self.dataset_id, "minari_version": minari().__version__, **metadata}
            )
        namespace = self.dataset_id.rpartition("/")[0]
        if namespace and namespace not in list_local_namespaces():
            create_namespace(namespace)
        self.folder.mkdir(exist_ok=True)
        with suppress(FileNotFoundError):
            os.rename(self.folder / "data", self._draft / _REPLACED)  # if the process ends here, _delete goes on
        os.rename(self._draft / "data", self.folder / "data")
        return self.folder


def open_dataset(dataset: str) -> Any:
    """A ``minari.MinariDataset`` by its id or its folder; no code that it names is imported.

    Raises:
        ValueError: if there is none, or it cannot be read.
    """
    library, folder = minari(), dataset_folder(dataset)
    path = folder / "data"
    if not path.is_dir():
        raise ValueError(
            f"no dataset {dataset} in {folder.parent}: record it with planarm dataset, or minari download {dataset}"
        )
    metadata = read_document(path / "metadata.json", _MOST_METADATA)
    # Minari would make the environment, whose entry point can be any code, to find out its spaces.
    if not isinstance(metadata, dict) or not {"observation_space", "action_space"} <= metadata.keys():
        raise ValueError(f"{path / 'metadata.json'} does not describe the observations and actions")
    try:
        return library.MinariDataset(path)
    except Exception as error:  # a damaged file can fail in any way
        raise ValueError(f"cannot read {path}: {type(error).__name__}: {str(error)[:300]}") from None


def fingerprint(dataset: Any) -> str:
    """A hash of the episodes of a ``minari.MinariDataset`` as they are stored."""
    content = hashlib.sha256()
    for path in sorted(Path(dataset.storage.data_path).rglob("*")):
        if path.is_file() and path.name != "metadata.json":
            with path.open("rb") as file:
                content.update(hashlib.file_digest(file, "sha256").digest())
    return content.hexdigest()


def as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as JSON holds them: NumPy's numbers and arrays as Python's."""

    def plain(value: Any) -> Any:
        return value.tolist() if hasattr(value, "tolist") else str(value)

    document: dict[str, Any] = json.loads(json.dumps(dict(values), default=plain))
    return document


def _require_apart(dataset_id: str, root: Path) -> None:
    """Raise a ValueError for an id inside or around other datasets, or where one keeps its files.

    Minari deletes a dataset with all that its folder holds.
    """
    parts = Path(dataset_id).parts
    if "data" in parts:
        raise ValueError(f"dataset {dataset_id} has a part data, where Minari keeps the files of a dataset: rename it")
    for number in range(1, len(parts)):
        if (root.joinpath(*parts[:number]) / "data").exists():
            outer = "/".join(parts[:number])
            raise ValueError(f"dataset {dataset_id} would be inside dataset {outer}, and deleted with it: rename it")
    own = root.joinpath(*parts)
    for data in own.rglob("data"):
        if data.parent != own and own / "data" not in data.parents:
            inner = data.parent.relative_to(root).as_posix()
            raise ValueError(
                f"dataset {dataset_id} would be around dataset {inner}, which would be deleted with it: rename it"
            )


def _tidy(root: Path) -> None:
    """Delete the drafts of processes that are no more, and end the replacements that they had begun."""
    for path in root.glob(f"{_DRAFT}*-*"):
        number = path.name.removeprefix(_DRAFT).partition("-")[0]
        if number.isdecimal() and not _runs(int(number)):
            _delete(path)


def _delete(draft: Path) -> None:
    """Delete a draft; a dataset that it was about to replace is replaced first, since the new one is whole."""
    if (draft / _REPLACED).exists() and (draft / "data").exists():
        dataset_id = read_document(draft / "data" / "metadata.json", _MOST_METADATA)["dataset_id"]
        with suppress(FileExistsError, OSError):  # recorded again meanwhile
            os.rename(draft / "data", folder_of_id(dataset_id) / "data")
    shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name a path in the error of a write that does not."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
