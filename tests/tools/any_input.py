"""Inputs of every kind, made from a seed: scenes as TOML, values of --set, options, state files, stores, exports, meshes and
odd names, most of them wrong. `Maker(seed, folder).case()` is the next; any_answer.py says what becomes of it."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import sqlite3
import string
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from odd_values import (
    CELLS,
    DEVICES,
    DOCUMENTED,
    LITTLE,
    MARKS,
    MEASURING,
    NAMES,
    NUMBERS,
    OBJ,
    OF_MESHES,
    OPTION_VALUES,
    OWN,
    RUN_OPTIONS,
    SCENES,
    SETTINGS,
    STORED,
    TEXTS,
    WHOLE,
    WORDS_OF_NAMES,
    arrays_of,
    frames_of,
)  # fmt: skip

from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export
from softlab.model.scene.reader import catalogue
from softlab.model.tables.kinds import KINDS

FIELDS = [(kind, name) for kind, part in KINDS.items() for name in part.model_fields]


@dataclass
class Case:
    """A command line, typed in the maker's folder; a message about it must hold one of `names`."""

    argv: list[str]
    names: list[str] = field(default_factory=list)


class Maker:
    """Makes cases, each from the seed and its number alone. What they need lies in `folder`."""

    def __init__(self, seed: int, folder: Path):
        self.seed, self.folder, self.number = seed, folder, 0
        self.random = random.Random(seed)
        files = catalogue()
        self.scenes = {name: tomllib.loads(files[name].read_text(encoding="utf-8")) for name in SCENES}
        self._furnish()

    def case(self) -> Case:
        """The next one."""
        self.number += 1
        self.random = random.Random(f"{self.seed} {self.number}")
        kinds = {
            self._scene_file: 30, self._setting: 25, self._text: 8, self._options: 12, self._state: 8, self._export: 3,
            self._store: 3, self._measuring: 6, self._name: 6, self._mesh: 4, self._energies: 1,
        }  # fmt: skip
        return self.random.choices(list(kinds), list(kinds.values()))[0]()

    def _furnish(self) -> None:
        """What lies in the folder: pipes and links without an end, good files to be bent."""
        for name in DEVICES if hasattr(os, "mkfifo") else ():
            os.mkfifo(self.folder / name)
        (self.folder / "loop.toml").symlink_to("loop.toml")
        (self.folder / "folder.toml").mkdir()
        np.save(self.folder / "array.npy", np.zeros(3))
        (self.folder / "mesh.obj").write_text(OBJ)
        with Store(self.folder / "good.sqlite") as store:
            store.add_machine("m1", "a machine", {"cores": 2, "test": 1})
            store.connection.execute("INSERT INTO run VALUES ('r1', 'm1', NULL, '2026-01-01', 'softlab')")
            for k in range(3):
                described = {"backend": "cpu", "k": k, "scene": {"grid": {"rows": 2, "columns": 2}}}
                store.add_sample("r1", described, "s", 0.5 + k, 100, joules=1.5)
                store.add_measure("r1", described, "s", "error", 0.1 * k)
            export(store, self.folder / "good.csv")
        with contextlib.closing(sqlite3.connect(self.folder / "good.sqlite")) as opened:
            opened.execute("PRAGMA journal_mode = DELETE")  # one file

    def _file(self, suffix: str, data: bytes) -> str:
        """The file of the case; the one before is replaced."""
        (self.folder / f"case{suffix}").write_bytes(data)
        return f"case{suffix}"

    def _without(self, *names: str) -> None:
        for pattern in names:
            for old in self.folder.glob(pattern):
                old.unlink()

    # ------------------------------------------------------------------ values

    def _value(self) -> Any:
        kinds = {"number": 35, "extreme": 15, "whole": 15, "text": 10, "truth": 7, "list": 12, "table": 3, "deep": 3}
        kind = self.random.choices(list(kinds), list(kinds.values()))[0]
        if kind == "number":
            return 10.0 ** self.random.uniform(-12, 12) * self.random.choice((1, 1, 1, -1))
        if kind == "list":
            size = self.random.choice((0, 1, 2, 3, 3, 3, 4, 50))
            return [self._value() if self.random.random() < 0.3 else self.random.choice(LITTLE) for _ in range(size)]
        if kind == "table":
            return {"name": self._value(), "x": 1}
        if kind == "deep":
            deep: Any = 0
            for _ in range(self.random.choice((5, 90, 300))):
                deep = [deep]
            return deep
        return self.random.choice({"extreme": NUMBERS, "whole": WHOLE, "text": TEXTS, "truth": (True, False)}[kind])

    def _near(self, value: Any) -> Any:
        """A number much like `value`, which most scenes take."""
        if isinstance(value, list):
            return [self._near(one) for one in value]
        if isinstance(value, bool) or not isinstance(value, int | float):
            return value
        factor = self.random.choice((2.0, 10.0, 1e3, 1e10, 1e40)) ** self.random.choice((1, -1))
        if isinstance(value, int):
            return value + 1 if value > 2**53 else max(1, min(int(value * factor), 3 * value + 2))
        return value * factor * self.random.choice((1, 1, 1, -1))

    def _written(self, value: Any) -> str:
        """As TOML writes it."""
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, float):
            text = repr(value)
            return text if "." in text or "n" in text else text.replace("e", ".0e")
        if isinstance(value, str):
            return json.dumps(value).replace("\x7f", "\\u007f")
        if isinstance(value, list | tuple):
            return f"[{', '.join(map(self._written, value))}]"
        if isinstance(value, dict):
            return f"{{ {', '.join(f'{json.dumps(k)} = {self._written(v)}' for k, v in value.items())} }}"
        return str(value)

    def _toml(self, tables: dict[str, Any]) -> bytes:
        lines = [f"{json.dumps(k)} = {self._written(v)}" for k, v in tables.items() if not isinstance(v, dict)]
        for name, table in tables.items():
            if isinstance(table, dict):
                lines.append(f"[{json.dumps(name)}]")
                lines += [f"{json.dumps(k)} = {self._written(v)}" for k, v in table.items()]
        return ("\n".join(lines) + "\n").encode()

    def _word(self) -> str:
        letters = string.ascii_letters + "_-. \u00e9"
        return "".join(self.random.choice(letters) for _ in range(self.random.choice((1, 3, 8, 30, 9000))))

    def _bent(self, data: bytes, marks: tuple[bytes, ...], most: int) -> bytes:
        """`data` with bytes changed, left out and put in, in up to `most` places."""
        bent = bytearray(data)
        for _ in range(self.random.randint(1, most)):
            place, what = self.random.randrange(len(bent) + 1), self.random.random()
            if what < 0.3:
                bent[place:place] = self.random.choice(marks)
            elif what < 0.6:
                del bent[place : place + self.random.choice((1, 3, 60))]
            elif what < 0.8 and place < len(bent):
                bent[place] = self.random.randrange(256)
            else:
                bent[place:place] = bent[: self.random.choice((10, 100))]
        return bytes(bent)

    def _command(self, scene: str) -> list[str]:
        json_told = ["--json"] if self.random.random() < 0.5 else []
        if self.random.random() < 0.5:
            return ["plan", scene, *json_told]
        judged = [] if self.random.random() < 0.05 else ["--no-judge"]
        return ["run", scene, "--steps", "3", *judged, *(json_told or ["--allow-unstable"])]

    # ------------------------------------------------------------------ scenes

    def _scene_file(self) -> Case:
        tables = json.loads(json.dumps(self.random.choice([*self.scenes.values(), *OWN])))
        names = ["case.toml", *KINDS, *tables]  # a fault may show in what goes with it
        for _ in range(self.random.choice((1, 1, 1, 2, 3))):
            own = [name for name, table in tables.items() if isinstance(table, dict)]
            names.append(self._mutated(tables, self.random.choice(own or ["grid"]), self.random.random()))
        return Case(self._command(self._file(".toml", self._toml(tables))), names)

    def _mutated(self, tables: dict[str, Any], part: str, what: float) -> str:
        """The part of a scene in which something is changed."""
        table = tables.setdefault(part, {})
        if what < 0.6:
            kind = table.get("kind", part)
            key = self.random.choice(
                list(KINDS[kind].model_fields) if isinstance(kind, str) and kind in KINDS else ["x"]
            )
            near = key in table and self.random.random() < 0.6
            table[key] = self._near(table[key]) if near else self._value()
        elif what < 0.75:
            part, key = self.random.choice(FIELDS)
            if isinstance(tables.setdefault(part, {}), dict):
                tables[part][key] = self._value()
        elif what < 0.85 and table:
            del table[self.random.choice(list(table))]
        elif what < 0.92:
            table[self._word()] = self._value()
        else:
            part = self._word()
            tables[part] = self._value() if self.random.random() < 0.5 else {"kind": self._value()}
        return part[:40]

    def _setting(self) -> Case:
        name = self.random.choice(list(self.scenes))
        argv, tables = self._command(name), self.scenes[name]
        for _ in range(self.random.choice((1, 1, 2))):
            own = [(part, table.get("kind", part)) for part, table in tables.items() if isinstance(table, dict)]
            part, key = self.random.choice(FIELDS)
            if self.random.random() < 0.8:
                part, kind = self.random.choice(own)
                key = self.random.choice(list(KINDS[kind].model_fields))
            given = tables.get(part, {}).get(key)
            near = given is not None and self.random.random() < 0.7
            text = self._written(self._near(given) if near else self._value())
            if self.random.random() < 0.05:
                text = self.random.choice(SETTINGS)
            path = f"{part}.{key}" if self.random.random() < 0.95 else self._word()
            argv += ["--set", f"{path}={text}"]
        return Case(argv, ["--set", *KINDS, *tables, path[:30]])

    def _text(self) -> Case:
        """A scene file that is bent as text."""
        text = self._bent(self._toml(self.random.choice(list(self.scenes.values()))), MARKS, 8)
        return Case(self._command(self._file(".toml", text)), ["case.toml", *KINDS, "title", " = "])

    def _mesh(self) -> Case:
        name = self._file(self.random.choice((".obj", ".obj", ".ply", ".stl")), self._bent(OBJ.encode(), CELLS, 5))
        tables = json.loads(json.dumps(self.random.choice(OF_MESHES)).replace("FILE", name))
        return Case(self._command(self._file(".toml", self._toml(tables))), [name, *tables, *KINDS])

    # ------------------------------------------------------------------ command lines and files

    def _options(self) -> Case:
        argv = ["run", self.random.choice(("lab-grid", "rope", "cloth-wind")), "--no-judge"]
        for _ in range(self.random.choice((1, 1, 2, 3))):
            argv += [self.random.choice(RUN_OPTIONS), self.random.choice(OPTION_VALUES)]
            if argv[-2] == "--record":
                argv.append(self.random.choice(NAMES))
        if self.random.random() < 0.1:
            argv.append(self._word())
        return Case(argv, ["--", *(_shown(word) or word or "''" for word in argv[3:])])

    def _state(self) -> Case:
        scene, count = self.random.choice((("lab-grid", 1024), ("rope", 100)))
        good = arrays_of(count)
        odd = good.pop("odd")
        for _ in range(self.random.choice((0, 1, 2))):
            key = self.random.choice([*good, "inverse_mass", "rotation", "plastic"])
            good[key] = self.random.choice(odd)
        if self.random.random() < 0.1:
            del good[self.random.choice(list(good))]
        data = _npz(good)
        if self.random.random() < 0.4:
            data = self._bent(data, MARKS, 5)
        name = self._file(".npz", data) if self.random.random() < 0.9 else self.random.choice(NAMES)
        names = [
            _shown(name) or name or "''",
            "position",
            "velocity",
            "inverse_mass",
            "rotation",
            "plastic",
            "time",
            "step",
            "directory",
        ]
        return Case(["run", scene, "--steps", "3", "--no-judge", "--initial", name], names)

    def _export(self) -> Case:
        file = self._file(".csv", self._bent((self.folder / "good.csv").read_bytes(), CELLS, 5))
        target = self.random.choice(("new.sqlite", "odd name?.sqlite", "target.sqlite"))
        return Case(["merge", file, "--store", target], [file, target])

    def _store(self) -> Case:
        self._file(".sqlite", (self.folder / "good.sqlite").read_bytes())
        with contextlib.closing(sqlite3.connect(self.folder / "case.sqlite")) as opened:
            for _ in range(self.random.choice((0, 1, 2))):
                table = self.random.choice(("machine", "run", "configuration", "sample", "measure"))
                column = self.random.choice([row[1] for row in opened.execute(f"PRAGMA table_info({table})")])
                with contextlib.suppress(sqlite3.Error):
                    opened.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = 1", (self.random.choice(STORED),))
            opened.commit()
        if self.random.random() < 0.2:
            self._file(".sqlite", self._bent((self.folder / "case.sqlite").read_bytes(), CELLS, 20))
        self._without("out.*", "new.*")
        target = self.random.choice((["export", "out.csv", "--store"], ["export", "out.sqlite", "--store"], ["merge"]))
        return Case(
            [*target, "case.sqlite", *(["--store", "new.sqlite"] if target == ["merge"] else [])],
            ["case.sqlite", "out."],
        )

    def _measuring(self) -> Case:
        command, store = self.random.choice(list(MEASURING)), self.random.choice(NAMES)
        scene = [self.random.choice(("lab-grid", "nothing", "x" * 5000))] if command in ("ablate", "advise") else []
        argv = [command, *scene, "--store", store]
        for option in self.random.sample(
            MEASURING[command], min(len(MEASURING[command]), self.random.choice((1, 1, 2)))
        ):
            argv += [option, self.random.choice(OPTION_VALUES)]
        return Case(argv, [_shown(store) or "directory", "--", "scene", *DOCUMENTED])

    def _name(self) -> Case:
        odd = self.random.choice(NAMES)
        words = [word.replace("ODD", odd) for word in self.random.choice(WORDS_OF_NAMES)]
        self._without("new.*", "*-energies.*")
        return Case(words, [_shown(odd) or "''", "--", "SCENE", "cloth", "jelly", *DOCUMENTED])

    def _energies(self) -> Case:
        held = frames_of(3)
        odd = held.pop("odd")
        held[self.random.choice(list(held))] = self.random.choice(odd)
        self._without("*-energies.*")
        return Case(["figures", "--energies", self._file(".npz", _npz(held)), "--out", "."], ["case.npz"])


def _npz(arrays: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _shown(word: str) -> str:
    """How a message begins to show a word."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in word)[:30].rstrip("/ ")
