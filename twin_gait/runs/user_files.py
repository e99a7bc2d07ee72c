"""Copies of the user's files in a folder, so that it can be read on another machine: URDF, meshes and DBC.

Person, gait table and modes need no copy, because ``experiment.yaml`` contains them.
"""

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from twin_gait.experiment.experiment import Experiment
from twin_gait.files import shipped_file, write_atomically
from twin_gait.leg_model.urdf import find_urdf
from twin_gait.network.dbc import find_dbc

FILES_FOLDER = "files"


class StoredFile(NamedTuple):
    """File that an experiment names, and its copy in a folder."""

    section: str  # section of the experiment file that names the file
    path: Path  # absolute path of the original
    name: str  # path of the copy in the folder, or name of a file of the package, which is not copied

    @property
    def is_copied(self) -> bool:
        """Whether the folder contains a copy."""
        return self.name != self.path.name

    def is_stored_in(self, folder: Path) -> bool:
        """Return whether a folder has an up-to-date copy of this file, or needs none."""
        copy = folder / self.name
        return not self.is_copied or (copy.is_file() and copy.read_bytes() == self.path.read_bytes())


def stored_file(section: str, path: Path, folder: str = FILES_FOLDER) -> StoredFile:
    """Return a file with the name of its copy in ``folder``, a relative path."""
    shipped = shipped_file(path.name)
    ships = shipped is not None and shipped.read_bytes() == path.read_bytes()
    return StoredFile(section, path, path.name if ships else Path(folder, path.name).as_posix())


def referenced_files(experiment: Experiment) -> list[StoredFile]:
    """Return the files that an experiment names."""
    files = [stored_file("leg", find_urdf(experiment.leg.urdf))]
    if experiment.network is not None and experiment.network.dbc:
        files.append(stored_file("network", find_dbc(experiment.network.dbc)))
    return files


def store_files(files: Iterable[StoredFile], folder: Path) -> dict[str, str]:
    """Copy files into a folder, a URDF with its meshes, unless they are part of the package.

    Returns their names in ``experiment.yaml`` by section. Raises RunDirectoryError if a copy cannot be
    written.
    """
    names = {}
    for file in files:
        names[file.section], copy = file.name, folder / file.name
        if file.is_copied:
            copy.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(copy, file.path.read_bytes())
            if file.section == "leg":
                _store_meshes(file.path, copy.parent)
    return names


def _store_meshes(urdf: Path, folder: Path) -> None:
    from twin_gait.viewer.visuals import mesh_files, stored_mesh  # the import of the viewer is slow

    for name, path in mesh_files(urdf).items():
        copy = stored_mesh(name, folder)
        try:
            content = path.read_bytes()
        except OSError as error:
            warnings.warn(f"{path}: mesh cannot be copied ({error.strerror})", stacklevel=2)
            continue
        copy.parent.mkdir(exist_ok=True)
        write_atomically(copy, content)
