"""Reading a mission part by part, and noting what is wrong in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path as FilePath
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.mission.actions import FollowerUse, PluginUse
from artemis.mission.files import files_like, read_data, read_table
from artemis.mission.injector import FaultInjector
from artemis.mission.page import add_page
from artemis.mission.parts import expanded, without
from artemis.mission.problems import UNKNOWN_KEY, Model, nearest, placed
from artemis.plugins.registry import BEHAVIOURS, names
from artemis.yaml_file import Data, Document, KeyPath, read, survey

if TYPE_CHECKING:
    from artemis.motion.route import Route
    from artemis.route_planning.floor import Destination

Configs = Mapping[str, Config | None]


class MissionReading:
    """A mission file, and what is wrong in it; a wrong part does not hide the others."""

    def __init__(self, path: FilePath, simulate: bool = False, page: Mapping[str, Any] | None = None) -> None:
        self._folder = path.parent
        self._problems: list[str] = []
        self._wrong: list[KeyPath] = []
        """Where the schemas found something wrong in the mission."""
        self._unknown: list[KeyPath] = []
        """Those of them that are unknown keys."""
        self._documents: dict[str, Document] = {}
        self._files: dict[str, bytes] = {}
        self._remarks: list[str] = []
        self._routes: dict[int, Route] = {}
        self._destinations: dict[int, Destination] = {}
        self._plugins: dict[KeyPath, tuple[Any, Config]] = {}
        self._injector: FaultInjector | None = None
        self._installed = cache(partial(names, BEHAVIOURS))
        self._document = self._survey(read(path), str(path))
        document, misfits = expanded(self._document, self._parts_in_files())
        self._document = self._documents[str(path)] = document
        for place, problem in misfits:
            self._complain(place, problem)
        self._data = self._document.data if isinstance(self._document.data, dict) else {}
        if page is not None:
            add_page(self._data, page)
        self._simulated = simulate or self._data.get("bus") == "simulation"
        self._robot_source = str(path)

    def _survey(self, raw: bytes, source: str) -> Document:
        document, problems = survey(raw, source)
        self._problems += problems
        self._documents[source] = document
        return document

    def _complain(self, path: KeyPath, text: str) -> None:
        if path not in self._document.damaged:
            self._problems.append(self._document.problem(path, text))

    def _validated(
        self, model: type[Model], document: Document, at: KeyPath = (), data: Data | Mapping[str, object] = None
    ) -> Model | None:
        """The part of a document at `at` as `model`; what is wrong is noted."""
        try:
            return model.model_validate(document.data if data is None else data, context=self._installed)
        except ValidationError as error:
            found = placed(error, document, model, at)
            self._problems += [document.problem(path, text) for path, text in found]
            if document is self._document:
                self._wrong += [path for path, _ in found]
                self._unknown += [path for path, text in found if text.startswith(UNKNOWN_KEY)]
            return None

    def _part(self, model: type[Model], *path: str | int) -> Model | None:
        """A part of the mission, if it is right but for unknown keys: what is wrong, the mission's model reports."""
        part: Any = self._data
        for key in path:
            part = part[key]
        for unknown in (found[len(path) :] for found in self._unknown if found[: len(path)] == path):
            part = without(part, unknown)
        try:
            return model.model_validate(part, context=self._installed)
        except ValidationError:
            return None

    def _names(self, *path: str) -> list[str]:
        """Keys of a mapping in the mission; none where it is missing or something else."""
        part: Data = self._data
        for key in path:
            part = part.get(key) if isinstance(part, dict) else None
        return list(part) if isinstance(part, dict) else []

    def _file(self, path: KeyPath, name: str, reader: Callable[[FilePath], bytes] = read_table) -> bytes | None:
        """Content of a file that the mission names at `path`."""
        if name in self._files:
            return self._files[name]
        root = os.path.realpath(self._folder)
        if os.path.isabs(name) or os.path.commonpath([root, os.path.realpath(self._folder / name)]) != root:
            self._complain(path, f"outside the mission's folder {self._folder}: {name}; copy the file there")
            return None
        try:
            self._files[name] = reader(self._folder / name)
        except ConfigError as error:
            reason = str(error).removeprefix(f"{self._folder / name}: ")
            hint = nearest(name, files_like(self._folder, name), "files of that kind") if "not found" in reason else ""
            self._complain(path, f"{reason}: {name}{hint}")
        return self._files.get(name)

    def _yaml_file(self, path: KeyPath, name: Data) -> Document | None:
        """The YAML file that the mission names at `path`; None: it names none, or it cannot be read."""
        raw = self._file(path, name, read) if isinstance(name, str) and name else None
        if raw is None:
            return None
        try:
            return self._survey(raw, str(self._folder / str(name)))
        except ConfigError as error:
            self._problems += error.problems
            return None

    def _parts_in_files(self) -> dict[str, Document]:
        """Parts that stand in files of their own, by their names in the mission."""
        found: dict[str, Document] = {}
        parts = self._document.data.get("parts") if isinstance(self._document.data, dict) else None
        for name, part in parts.items() if isinstance(parts, dict) else ():
            file = part.get("file") if isinstance(part, dict) and len(part) == 1 else None
            document = self._yaml_file(("parts", name, "file"), file)
            if document is None:
                continue
            found[name] = document
            if isinstance(document.data, dict) and "file" in document.data:
                self._problems.append(document.problem(("file",), "a part's file has its steps itself"))
        return found

    def _plugin(self, group: str, *path: str | int) -> Config | None:
        """Options of the plugin that the mission uses at `path`, with the files they name."""
        use = self._part(FollowerUse if group == "artemis.followers" else PluginUse, *path)
        return None if use is None else self._used(group, use.plugin, path, use.options)

    def _used(self, group: str, name: str, path: KeyPath, options: Mapping[str, object]) -> Config | None:
        """The same of a plugin by its name."""
        from artemis.plugins.registry import load

        try:
            plugin = load(group, name)
        except ConfigError as error:
            for problem in error.problems:
                self._complain((*path, "plugin"), problem)
            return None
        config = self._options(plugin, path, options)
        if config is not None:
            self._plugins[path] = plugin, config
        return config

    def _options(self, plugin: Any, path: KeyPath, options: Mapping[str, object]) -> Config | None:  # noqa: ANN401
        """The options of a plugin at `path`, with the files they name."""
        config: Config | None = self._validated(plugin.Config, self._document, path, options)
        for name, value in config or ():
            if isinstance(value, str) and (name == "file" or name.endswith("_file")):
                self._file((*path, name), value, read_data)
            elif isinstance(value, str) and name == "map":
                self._map((*path, name), value)
        return config

    def _map(self, path: KeyPath, name: str) -> None:
        """The YAML file of a map, and the image that it names; whoever reads the map says what is wrong in it."""
        document = self._yaml_file(path, name)
        if (
            document is not None
            and isinstance(document.data, dict)
            and isinstance(image := document.data.get("image"), str)
        ):
            self._file(path, str(PurePosixPath(name).parent / image))
