"""The keys of the demo's window, in words: the help of key H and the hint at the bottom. README.md and docs/demo.md list
them too."""

from __future__ import annotations

from itertools import zip_longest

SPACE = "space bodies tetrahedra fluid world"
MASSES = "plane space tetrahedra world"
KEYS = (  # key, its effect, and the subjects (View.subject) that have it; none: all
    ("G", "gravity on, off", ""),
    ("[ ]", "time step / 1.25, x 1.25", ""),
    ("{ }", "stiffness / 1.25, x 1.25", "plane space"),
    ("{ }", "Young's modulus / 1.25, x 1.25", "tetrahedra"),
    ("( )", "Poisson's ratio down, up", "tetrahedra"),
    ("< >", "damping / 2, x 2", "tetrahedra"),
    ("- +", "fewer, more steps per frame", ""),
    ("space", "pause, continue", ""),
    ("R", "restart, original settings", ""),
    ("B", "switch CPU, GPU; state kept", ""),
    ("T", "1, 2, 4 threads per core", ""),
    ("P K C I", "particles, skin, clusters, links", "bodies"),
    ("L", "surface, springs", "space"),
    ("L", "particles or skin", "bodies"),
    ("L", "edges of tetrahedra, or surface", "tetrahedra"),
    ("L", "surface, particles", "fluid"),
    ("L", "skins, or particles and edges", "world"),
    ("K", "skin, or the mesh's surface", "tetrahedra"),
    ("O", "colour by body, group, cluster", "bodies"),
    ("O", "colour by body, stress, strain", "tetrahedra"),
    ("O", "colour by fluid, speed, density", "fluid"),
    ("W", "spray, foam, bubbles on, off", "fluid world"),
    ("V", "picture fine, plain, quick", SPACE),
    ("D X", "drop a body, remove one", "bodies"),
    ("mouse", "drag a mass: pull it", MASSES),
    ("mouse", "drag a body: pull it", "bodies"),
    ("mouse", "drag a particle: pull it", "fluid"),
    ("arrows", "select a mass", MASSES),
    ("arrows", "select a particle", "bodies fluid"),
    ("Enter", "push it (down, or last arrow)", f"{MASSES} fluid"),
    ("Enter", "push its body (down, or arrow)", "bodies"),
    ("left", "drag beside: rotate (middle)", SPACE),
    ("wheel", "zoom at the pointer", ""),
    ("right", "drag: move the view", ""),
    ("F", "fit everything in view", ""),
    ("M", "graph of frame times", ""),
    ("N", "numbers at the top on, off", ""),
    ("A", "panel with all settings", ""),
    (".", "pause, do one step", ""),
    ("S", "save a picture (PNG)", ""),
    ("Escape", "close", ""),
)
IN_SPACE = ("V", "left")  # of no use in a plane, where fluids may be
WORLDS_KEY = ("Tab", "change one scene only, or all")
TWO_COLUMNS_FROM = 780  # pixels of window width
_END = "F: fit in view    space: pause    R: restart    Escape: close"
HINTS = {  # the keys needed first, by what a view shows (View.subject), or of sheets in space and in a plane
    "bodies": f"H: keys    A: panel    P: particles    K: skin    drag a body: pull it    drag beside it: rotate    {_END}",
    "tetrahedra": f"H: keys    A: panel    O: stress, strain    K: skin, mesh    drag beside the bodies: rotate    {_END}",
    "fluid": f"H: keys    A: panel    L: surface, particles    O: colours    drag beside the fluid: rotate    {_END}",
    "world": f"H: keys    A: panel    L: skins, particles and edges    drag beside the bodies: rotate    {_END}",
    "space": f"H: keys    A: panel    L: surface, springs    drag a mass: pull it    drag beside it: rotate    {_END}",
    "plane": f"H: keys    A: panel    G: gravity    drag a mass: pull it    [ ]: time step    {_END}",
}


def keys_of(subject: str, space: bool) -> list[tuple[str, str]]:
    """Return (key, its effect) of a window that shows the `subject`, in a plane or in space."""
    listed = [(key, effect) for key, effect, of in KEYS if not of or _named(subject, space) in of.split()]
    return [row for row in listed if space or row[0] not in IN_SPACE]


def _named(subject: str, space: bool) -> str:
    return subject if subject in HINTS else "space" if space else "plane"


def hint(subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """Return the keys that a user needs first. Parameters as of `keys_text`."""
    text = HINTS[_named(subject, space)]
    if several:  # the last keys give way to it: the legend is beside them
        return text.replace("H: keys", "H: keys    Tab: change one scene only").replace(
            "    R: restart    Escape: close", ""
        )
    return text


def keys_text(width: int, subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """Return the keys and their effects, in lines that fit a window of `width` pixels. `subject`: the thing that is
    shown (View.subject); `space`: in three dimensions; `several`: worlds side by side."""
    keys = (*((WORLDS_KEY,) if several else ()), *keys_of(subject, space))
    lines = [f"{key:8}{meaning:35}" for key, meaning in keys]
    if width >= TWO_COLUMNS_FROM:
        half = (len(lines) + 1) // 2
        lines = [left + right for left, right in zip_longest(lines[:half], lines[half:], fillvalue="")]
    return "\n".join(line.rstrip() for line in [*lines, "H       show, hide these keys"])
