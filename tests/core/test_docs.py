"""The documents are true: their Python runs, the README's commands are what they are said to be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def python_blocks(name: str) -> str:
    text = (ROOT / name).read_text(encoding="utf-8")
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


@pytest.mark.parametrize("name", ["docs/python.md", "README.md"])
def test_the_python_in_the_documents_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(python_blocks(name), name, "exec"), {"__name__": "document"})
    assert capsys.readouterr().out


def test_the_errors_in_the_example_are_as_told(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(python_blocks("docs/python.md"), "docs/python.md", "exec"), {"__name__": "document"})
    errors = dict(re.findall(r"^([a-z0-9-]+) +([0-9.e+-]+) of the spacing$", capsys.readouterr().out, re.MULTILINE))
    assert float(errors["lab"]) > 10 * float(errors["semi-implicit-euler"])
    assert float(errors["semi-implicit-euler"]) > float(errors["velocity-verlet"])
    assert float(errors["velocity-verlet"]) > float(errors["rk4"])


def test_the_page_names_what_read_and_set_know() -> None:
    from softlab.model.core.options import LIVE_PATHS
    from softlab.model.core.simulation import Simulation

    read, live = re.findall(
        r"^\| `(?:read|live)`.*?\n\n", (ROOT / "docs/python.md").read_text("utf-8"), re.DOTALL | re.MULTILINE
    )
    names = {
        name for row in re.findall(r"^\| (`.*?`) \|", read, re.MULTILINE)[1:] for name in re.findall(r"`(\w+)`", row)
    }
    told = (Simulation.read.__doc__ or "").partition("name : str")[2].partition("into : array")[0]
    assert names == set(re.findall(r"`(\w+)`", "".join(re.findall(r"^ +(`\w+`.*?) : ", told, re.MULTILINE))))
    rows = {
        name: re.findall(r"`(\w+\.\w+)`", paths)
        for name, paths in re.findall(r"^\| `(\w+)` \| (.*) \|$", live, re.MULTILINE)
    }
    assert {name: tuple(paths) for name, paths in rows.items() if name != "live"} == LIVE_PATHS


def test_files_that_the_documents_name_exist() -> None:
    """Tests and modules that a page cites by their path."""
    for document in (ROOT / "docs").rglob("*.md"):
        if document.name != "changelog.md":
            for path in re.findall(
                r"[(`]((?:tests|model|bench|app|cpu_backend|gpu_backend|plots|labbook)/[\w/]+\.py)",
                document.read_text("utf-8"),
            ):
                assert "NAME" in path or (ROOT / path).exists(), f"{document.name}: {path}"


ITEM = re.compile(r"([-*+]|\d+\.) ")


def blocks(text: str) -> list[list[str]]:
    """The lines between blank ones, headings apart, without fenced code."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    found = re.split(r"\n\s*\n|^#.*\n", text, flags=re.MULTILINE)
    return [block.strip("\n").splitlines() for block in found if block.strip()]


def test_no_list_of_the_site_runs_together_with_the_paragraph_above_it() -> None:
    """Python-Markdown begins a list after a blank line or a heading, and nowhere else."""
    for document in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for first, *more in blocks(document.read_text(encoding="utf-8")):
            if not ITEM.match(first.lstrip()) and not first.startswith(" "):
                assert not [line for line in more if ITEM.match(line)], f"{document.name}: {first}"


def test_pages_ask_for_nothing_that_the_theme_would_fetch_from_elsewhere() -> None:
    """Diagrams of mermaid come by a script from another host."""
    assert "font: false" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for document in (ROOT / "docs").rglob("*.md"):
        text = document.read_text(encoding="utf-8")
        assert not re.findall(r"^\s*```\s*mermaid|<script|!\[[^\]]*\]\(https?:", text, re.MULTILINE), document.name


def test_links_in_the_documents_lead_somewhere() -> None:
    for document in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


@pytest.mark.parametrize("name", ["README.md", "docs/commands.md", "docs/index.md"])
def test_every_command_of_the_documents_exists(name: str) -> None:
    from softlab import cli

    known = {command.name or command.callback.__name__ for command in cli.app.registered_commands}  # type: ignore[union-attr]
    text = (ROOT / name).read_text(encoding="utf-8")
    for line in re.findall(r"^softlab ([^#\n]+)", text, re.MULTILINE):
        for part in re.split(r" {2,}", line)[0].split("|"):
            assert part.split()[0] in known, line


def test_the_gallery_has_every_scene_and_its_picture() -> None:
    """Made anew: python docs/gallery.py --render SCENE."""
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location("gallery", ROOT / "docs" / "gallery.py")
    assert spec is not None and spec.loader is not None
    gallery = module_from_spec(spec)
    spec.loader.exec_module(gallery)
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.page(), "python docs/gallery.py writes it anew"
    missing = [name for name in gallery.scenes() if not (gallery.PICTURES / f"{name}.webp").exists()]
    assert not missing, "python docs/gallery.py --render " + " ".join(missing)


def test_every_page_of_the_site_is_in_its_menu() -> None:
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("nav:")[2]
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert pages == set(re.findall(r": ([a-z/-]+\.md)$", menu, re.MULTILINE))
