"""Writer of docs/gallery.md: every scene of the catalogue with its picture and the command that draws it.

`python docs/gallery.py` writes the page. `python docs/gallery.py --render [SCENE ...]` first draws the pictures of the named
scenes, or of all (a few minutes), with `softlab run --render`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from softlab.model.scene.reader import catalogue  # noqa: E402

PAGE, PICTURES = ROOT / "docs" / "gallery.md", ROOT / "docs" / "images" / "gallery"
BOOK = ROOT / "labbook" / "pictures"  # of the scenes that the lab book shows, which it comes with
WIDTH, QUALITY = 640, 72  # pixels, of WebP
SECONDS = 2.0  # simulated before a picture is drawn, where WHEN says nothing else
WHEN = {
    "column": 1.0, "dam-break": 0.8, "fountain": 2.0, "pour": 2.0, "lab-water": 1.2, "surf": 0.75, "taylor-green": 0.5,
    "two-fluids": 6.0, "float": 2.5, "wet-cloth": 2.5, "jelly-bowl": 2.5,
    "cloth-compute": 1.2, "cloth-draped-twice": 3.0, "cloth-flamenco": 1.0, "cloth-hanging": 1.0, "cloth-self": 1.5,
    "cloth-small-steps": 1.0, "cloth-twist": 2.0, "fem-attached": 1.5, "fem-cantilever": 0.6, "fem-creature": 2.5,
    "fem-descent": 0.5, "fem-drop": 2.5, "fem-newton": 0.5, "fem-steel-and-jelly": 0.6, "jelly-block": 0.7, "jelly-drop": 1.0,
    "jelly-grid": 6.0, "lab-curtain": 1.5, "lab-grid": 10.0, "lab-hammock": 1.5, "plastic": 2.5,
    "rope": 1.0, "rope-stiff": 0.8, "rope-stiff-still": 8.0, "soft-on-field": 1.5, "soft-pile": 1.2, "soft-rain": 1.2,
    "sticky": 1.6, "two-worlds": 0.9, "two-worlds-moon": 0.9,
}  # fmt: skip
SMALLER = {"soft-rain": ("drop.copies=[10, 2, 10]",)}  # what --set makes of a scene that is for a GPU
SECTIONS = {
    "lab-water": "Fluids",
    "lab-": "The grid of the lab", "cloth-": "Cloth", "rope": "Ropes",
    "jelly-bowl": "Fluids", "jelly-": "Shape matching", "soft-": "Shape matching", "rigid-": "Shape matching",
    "plastic": "Shape matching",
    "sticky": "Shape matching", "two-worlds": "Shape matching", "fem-": "Tetrahedra with Young's modulus",
    "column": "Fluids", "dam-": "Fluids", "fountain": "Fluids", "pour": "Fluids", "taylor-": "Fluids", "two-fluids": "Fluids",
    "surf": "Fluids", "float": "Fluids", "wet-cloth": "Fluids",
}  # fmt: skip
OTHER = "More"
HEAD = """# Gallery

All scenes that come with softlab. `softlab demo SCENE` shows a scene in a window, `softlab run SCENE --render scene.mp4`
writes a clip; add `--backend gpu` to use a GPU. `python docs/gallery.py` writes this page.
"""


def scenes() -> list[str]:
    """The catalogue's names, in the order of the page's sections."""
    names = [name for name in catalogue() if "/" not in name]  # those in folders are hard cases, see `softlab hard`
    order = [*[*dict.fromkeys(reversed(SECTIONS.values()))][::-1], OTHER]  # by the last name of each
    return sorted(names, key=lambda name: (order.index(section(name)), name))


def section(name: str) -> str:
    """The heading that a scene stands under."""
    return next((title for start, title in SECTIONS.items() if name.startswith(start)), OTHER)


def told(name: str) -> str:
    """What a scene's file says of it: the lines before its first table, or else its title."""
    text = catalogue()[name].read_text(encoding="utf-8")
    lines = text.splitlines()
    comment = []
    for line in lines:
        if not line.startswith("#") or line.startswith("# -"):  # a list tells more than a gallery has room for
            break
        comment.append(line.lstrip("# "))
    return " ".join(comment).removesuffix(" Taken over as they stand:") or f"{tomllib.loads(text)['title']}."


def command(name: str) -> str:
    """What makes the picture."""
    changes = "".join(f" --set '{change}'" for change in SMALLER.get(name, ()))
    return f"softlab run {name} --time {WHEN.get(name, SECONDS):g}{changes} --render {name}.png"


def page() -> str:
    """The text of docs/gallery.md."""
    parts, heading = [HEAD], None
    for name in scenes():
        if section(name) != heading:
            heading = section(name)
            parts.append(f"## {heading}\n")
        parts.append(f"### {name}\n")
        parts.append(f"{told(name)}\n")
        if (PICTURES / f"{name}.webp").exists():
            parts.append(f"![{name}](images/gallery/{name}.webp)\n")
        parts.append(f"```sh\n{command(name)}\n```\n")
    return "\n".join(parts)


def draw(name: str) -> None:
    """The picture of a scene. Raises CalledProcessError where its run failed."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "scene.png"
        changes = [word for change in SMALLER.get(name, ()) for word in ("--set", change)]
        subprocess.run(
            [
                sys.executable, "-m", "softlab", "run", name, "--time", str(WHEN.get(name, SECONDS)), *changes,
                "--no-judge", "--render", str(drawn),
            ],
            check=True, stdout=subprocess.DEVNULL, cwd=ROOT,
        )  # fmt: skip
        with Image.open(drawn) as image:
            height = round(image.height * WIDTH / image.width)
            small = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
            small.save(PICTURES / f"{name}.webp", quality=QUALITY, method=6)
    if (copy := BOOK / f"{name}.webp").exists():
        shutil.copyfile(PICTURES / copy.name, copy)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--render", action="store_true", help="draw the pictures, too")
    parser.add_argument("scene", nargs="*", help="only the pictures of these")
    asked = parser.parse_args()
    wanted = asked.scene or scenes()
    if unknown := [name for name in wanted if name not in scenes()]:
        parser.error(f"{', '.join(unknown)}: not in the catalogue; softlab scenes lists it")
    for number, name in enumerate(wanted if asked.render else (), 1):
        print(f"{number} of {len(wanted)}: {name}", flush=True)
        draw(name)
    PAGE.write_text(page())


if __name__ == "__main__":
    main()
