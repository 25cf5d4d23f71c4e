"""Bad scenes: one clear line each (field, value, what is allowed), never a traceback of something else."""

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.app.driver import open_simulation
from softlab.model.base.errors import InputError, SceneError, SoftlabError
from softlab.model.core.build import build
from softlab.model.scene.reader import parse_settings
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.kinds import KINDS

NAN, INF = float("nan"), float("inf")


def one_line(error: SoftlabError) -> str:
    text = str(error)
    assert text
    assert "\n" not in text
    assert error.exit_status == 2
    return text


@pytest.mark.parametrize(
    ("path", "value"),
    [
        *[
            (f"grid.{side}", bad)
            for side in ("rows", "columns")
            for bad in (0, -3, 2.5, "many", NAN, INF, True, None, [])
        ],
        *[
            (path, bad)
            for path in ("grid.mass", "grid.spacing", "springs.stiffness", "method.dt")
            for bad in (0, 0.0, -1.0, NAN, INF, -INF, "heavy", None, True)
        ],
        *[
            (path, bad)
            for path in ("springs.rest_length", "damping.coefficient", "gravity.acceleration", "external.magnitude")
            for bad in (-1.0, NAN, INF, "much", None)
        ],
        *[("external.seed", bad) for bad in (-1, 2**64, 0.5, "dice")],
        *[("gravity.enabled", bad) for bad in ("yes", 1, None)],
        *[("method.integrator", bad) for bad in ("euler", "", 4, None)],
        *[("method.solver", bad) for bad in ("fem", 1)],
        *[
            ("grid.pinned", bad)
            for bad in (
                *("lowest", "every:0", "every:-1", "every:", "every:1.5", "TOP", 3, None, True),
                *([[0, 32]], [[32, 0]], [[-1, 0]], [[0]], [0, 1], [[0.5, 1]], [[True, 0]], [[0, 0, 0]], ["top"]),
            )
        ],
    ],
)
def test_bad_value(path, value):
    """Issue section 6: sizes, material constants, words and pins; the message names the field."""
    with pytest.raises(SceneError) as caught:
        load_scene("lab-grid").replace({path: value})
    assert path in one_line(caught.value)
    assert caught.value.field == path
    assert caught.value.allowed


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, "grid"),
        ({"grid": {"rows": 2}}, "grid.columns"),
        ({"grid": {"rows": 2, "columns": 2}, "grad": {}}, "did you mean grid"),
        ({"grid": {"rows": 2, "columns": 2, "colums": 3}}, "did you mean columns"),
        (
            {"gem": {"kind": "soft_body", "shape": {"file": "a.obj"}}},
            "gem.shape.file = 'a.obj': unknown key (did you mean gem",
        ),
        (
            {"gem": {"kind": "soft_body", "shape": {"nme": "star"}}},
            "gem.shape.nme = 'star': unknown key (did you mean name?",
        ),
        ({"gem": {"kind": "soft_body", "mesh": "a.obj"}}, "gem.mesh = 'a.obj': unknown key (did you mean file?"),
        ({"grid": 4}, "grid"),
        ({"grid": {"rows": 2, "columns": 2}, "title": 3}, "title"),
        (
            {"left": {"kind": "grid", "rows": 2, "columns": 2}, "right": {"kind": "grid", "rows": 2, "columns": 2}},
            "one part",
        ),
        ({"grid": {"rows": 2, "columns": 2}, "sheet": {"kind": "fabric"}}, "sheet.kind"),
        ({"grid": {"rows": 2, "columns": 2}, "sheet": {"kind": 3}}, "sheet.kind"),
        ({"grid": {"rows": 2, "columns": 2}, "gravity": {}, "moon": {"kind": "gravity"}}, "gravity"),
        ({"grid": {"rows": 2, "columns": 2, 5: 1}}, "names"),
    ],
)
def test_bad_scene(data, words):
    with pytest.raises(SceneError) as caught:
        Scene(data)
    assert words in one_line(caught.value)


@pytest.mark.parametrize("path", ["rows", "grid", "grid.", ".rows", "grid.rows.more", "gird.rows", "grid.row", ""])
def test_bad_path(path):
    with pytest.raises(SceneError) as caught:
        load_scene("lab-grid").replace({path: 3})
    one_line(caught.value)


@pytest.mark.parametrize("side", [10**6, 10**9, 2**31 - 1])
def test_larger_than_memory(side):
    """Says how much is needed and how much there is, before anything is allocated."""
    scene = load_scene("lab-grid").replace({"grid.rows": side, "grid.columns": side})
    with pytest.raises(SceneError) as caught:
        build(scene)
    assert "iB" in one_line(caught.value)
    assert "free" in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [{"grid.mass": 1e-300}, {"springs.stiffness": 1e300}, {"method.dt": 1e-100}, {"gravity.acceleration": 1e200}],
)
def test_values_that_the_precision_cannot_hold(changes):
    scene = load_scene("lab-grid").replace({"grid.rows": 3, "grid.columns": 3} | changes)
    with pytest.raises(SceneError) as caught:
        open_simulation(scene, allow_unstable=True)
    assert "float32" in one_line(caught.value)


@pytest.mark.parametrize(
    "options",
    [
        {"backend": "tpu"},
        {"precision": "float16"},
        {"math": "sloppy"},
        {"kernel": "magic"},
        {"threads": "3x"},
        {"live": ["pins"]},
    ],
)
def test_bad_options(options):
    scene = load_scene("lab-grid").replace({"grid.rows": 3, "grid.columns": 3})
    with pytest.raises(SceneError) as caught:
        open_simulation(scene, **options)
    one_line(caught.value)


def test_unknown_scene():
    with pytest.raises(InputError, match=r"unknown scene 'nothing'; `softlab scenes`"):  # no name is near
        load_scene("nothing")
    with pytest.raises(InputError, match="did you mean lab-grid") as caught:
        load_scene("lab-gird")
    one_line(caught.value)


def test_bad_scene_files(tmp_path):
    broken, binary, missing = tmp_path / "broken.toml", tmp_path / "binary.toml", tmp_path / "missing.toml"
    broken.write_text("[grid\nrows = ")
    mesh = tmp_path / "mine.obj"
    mesh.write_text("v 0 0 0\nf 1 1 1\n")
    binary.write_bytes(b"\xff\xfe\x00grid")
    for path, words in (
        (broken, "not TOML"), (binary, "UTF-8"), (missing, "no such file"), (tmp_path, "directory"),
        (mesh, r"\[mesh\] file = 'mine.obj'"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words) as caught:
            load_scene(path)
        one_line(caught.value)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root and Windows read every file")
def test_unreadable_scene_file(tmp_path):
    file = tmp_path / "locked.toml"
    file.write_text("[grid]\nrows = 2\ncolumns = 2\n")
    file.chmod(0)
    with pytest.raises(InputError, match="cannot be read"):
        load_scene(file)


# ---------------------------------------------------------------------- anything at all

KEYS = sorted({key for kind in KINDS.values() for key in kind.model_fields} | {"kind", "title", "worlds", "row"})
SCALARS = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from(["top", "rk4"])
)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)
TABLES = st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=6), VALUES, max_size=5)
SCENES = st.dictionaries(st.sampled_from([*KINDS, "title"]) | st.text(max_size=6), TABLES | VALUES, max_size=5)


def only_softlab_errors(action) -> None:
    try:
        action()
    except SoftlabError as error:
        one_line(error)


@settings(deadline=None, max_examples=150)
@given(SCENES)
def test_any_mapping(data):
    only_softlab_errors(lambda: Scene(data).canonical())


@settings(deadline=None, max_examples=100)
@given(st.sampled_from([f"{part}.{key}" for part, kind in KINDS.items() for key in kind.model_fields]), VALUES)
def test_any_value_of_any_field(path, value):
    only_softlab_errors(lambda: load_scene("lab-grid").replace({path: value}).canonical())


@settings(deadline=None, max_examples=100)
@given(st.text(max_size=60) | st.sampled_from(["[grid]\nrows = 1_0\ncolumns = 0x4", "a = 2024-01-01", "grid = [[]]"]))
def test_any_toml_text(tmp_path_factory, text):
    file = tmp_path_factory.getbasetemp() / "any.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    only_softlab_errors(lambda: load_scene(file))


@settings(deadline=None, max_examples=100)
@given(st.text(max_size=20))
def test_any_scene_name(text):
    only_softlab_errors(lambda: load_scene(text))


@settings(deadline=None, max_examples=150)
@given(
    st.sampled_from(["grid.rows", "grid.pinned", "method.dt", "external.seed", "gravity.enabled", "x"]),
    st.text(max_size=20),
)
def test_any_setting(path, text):
    only_softlab_errors(lambda: load_scene("lab-grid").replace(parse_settings([f"{path}={text}"])).canonical())


@settings(deadline=None, max_examples=100)
@given(st.lists(st.text(max_size=15), max_size=3))
def test_any_settings_text(texts):
    only_softlab_errors(lambda: load_scene("lab-grid").replace(parse_settings(texts)).canonical())


def test_steps_that_are_none_and_a_simulation_that_is_closed() -> None:
    with open_simulation(load_scene("lab-grid").replace({"grid.rows": 2, "grid.columns": 2})) as simulation:
        for wrong in (-1, 1.5, "x", None):
            with pytest.raises(SceneError, match="steps"):
                simulation.advance(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="closed"):
        simulation.advance(1)
