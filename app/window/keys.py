"""The keys of the demo's window, in words: the help of key H and the hint at the bottom. README.md and docs/demo.md list
them too."""

from __future__ import annotations

from itertools import zip_longest

KEYS = (
    ("G", "gravity on, off"),
    ("[ ]", "time step / 1.25, x 1.25"),
    ("{ }", "stiffness / 1.25, x 1.25"),
    ("- +", "fewer, more steps per frame"),
    ("space", "pause, continue"),
    ("R", "restart, original settings"),
    ("B", "switch CPU, GPU; state kept"),
    ("T", "1, 2, 4 threads per core"),
    ("mouse", "drag a mass: pull it"),
    ("arrows", "select a mass"),
    ("Enter", "push it (down, or last arrow)"),
    ("wheel", "zoom at the pointer"),
    ("right", "drag: move the view"),
    ("F", "fit everything in view"),
    ("M", "graph of frame times"),
    ("N", "numbers at the top on, off"),
    ("A", "panel with all settings"),
    (".", "pause, do one step"),
    ("S", "save a picture (PNG)"),
    ("Escape", "close"),
)
FOAM_KEY = ("W", "spray, foam, bubbles on, off")
DETAIL_KEY = ("V", "picture fine, plain, quick")
SPACE_KEYS = (
    *KEYS[:8],
    ("L", "surface, springs"),
    DETAIL_KEY,
    *KEYS[8:11],
    ("left", "drag beside: rotate (middle)"),
    *KEYS[11:],
)
BODY_KEYS = (  # without springs there is no stiffness to change
    *KEYS[:2],
    *KEYS[3:8],
    ("P K C I", "particles, skin, clusters, links"),
    ("L", "particles or skin"),
    ("O", "colour by body, group, cluster"),
    DETAIL_KEY,
    ("D X", "drop a body, remove one"),
    ("mouse", "drag a body: pull it"),
    ("arrows", "select a particle"),
    ("Enter", "push its body (down, or arrow)"),
    *SPACE_KEYS[13:],
)
TETRAHEDRA_KEYS = (
    *SPACE_KEYS[:2],
    ("{ }", "Young's modulus / 1.25, x 1.25"),
    ("( )", "Poisson's ratio down, up"),
    ("< >", "damping / 2, x 2"),
    *SPACE_KEYS[3:8],
    ("L", "edges of tetrahedra, or surface"),
    ("K", "skin, or the mesh's surface"),
    ("O", "colour by body, stress, strain"),
    *SPACE_KEYS[9:],
)
WORLD_KEYS = (
    *SPACE_KEYS[:2],
    *SPACE_KEYS[3:8],
    ("L", "skins, or particles and edges"),
    FOAM_KEY,
    *SPACE_KEYS[9:],
)
FLUID_KEYS = (
    *KEYS[:2],
    *KEYS[3:8],
    ("L", "surface, particles"),
    ("O", "colour by fluid, speed, density"),
    FOAM_KEY,
    DETAIL_KEY,
    ("mouse", "drag a particle: pull it"),
    ("arrows", "select a particle"),
    ("Enter", "push it (down, or last arrow)"),
    *SPACE_KEYS[13:],
)
WORLDS_KEY = ("Tab", "change one scene only, or all")
TWO_COLUMNS_FROM = 780  # pixels of window width
_END = "F: fit in view    space: pause    R: restart    Escape: close"
HINT = f"H: keys    A: panel    G: gravity    drag a mass: pull it    [ ]: time step    {_END}"
SPACE_HINT = f"H: keys    A: panel    L: surface, springs    drag a mass: pull it    drag beside it: rotate    {_END}"
BODY_HINT = (
    f"H: keys    A: panel    P: particles    K: skin    drag a body: pull it    drag beside it: rotate    {_END}"
)
TETRAHEDRA_HINT = (
    f"H: keys    A: panel    O: stress, strain    K: skin, mesh    drag beside the bodies: rotate    {_END}"
)
FLUID_HINT = f"H: keys    A: panel    L: surface, particles    O: colours    drag beside the fluid: rotate    {_END}"
WORLD_HINT = f"H: keys    A: panel    L: skins, particles and edges    drag beside the bodies: rotate    {_END}"
BY_SUBJECT = {  # of what a view shows (View.subject), or of sheets in space and in a plane: keys, and those needed first
    "bodies": (BODY_KEYS, BODY_HINT),
    "tetrahedra": (TETRAHEDRA_KEYS, TETRAHEDRA_HINT),
    "fluid": (FLUID_KEYS, FLUID_HINT),
    "world": (WORLD_KEYS, WORLD_HINT),
    "space": (SPACE_KEYS, SPACE_HINT),
    "plane": (KEYS, HINT),
}
IN_SPACE = (DETAIL_KEY, ("left", "drag beside: rotate (middle)"))  # keys that a plane has no use for


def _keys_and_hint(subject: str, space: bool) -> tuple[tuple[tuple[str, str], ...], str]:
    return BY_SUBJECT.get(subject) or BY_SUBJECT["space" if space else "plane"]


def hint(subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """Return the keys that a user needs first. Parameters as of `keys_text`."""
    _, text = _keys_and_hint(subject, space)
    if several:  # the last keys give way to it: the legend is beside them
        return text.replace("H: keys", "H: keys    Tab: change one scene only").replace(
            "    R: restart    Escape: close", ""
        )
    return text


def keys_text(width: int, subject: str = "sheet", space: bool = False, several: bool = False) -> str:
    """Return the keys and their effects, in lines that fit a window of `width` pixels. `subject`: the thing that is
    shown (View.subject); `space`: in three dimensions; `several`: worlds side by side."""
    listed = tuple(key for key in _keys_and_hint(subject, space)[0] if space or key not in IN_SPACE)
    keys = (*((WORLDS_KEY,) if several else ()), *listed)
    lines = [f"{key:8}{meaning:35}" for key, meaning in keys]
    if width >= TWO_COLUMNS_FROM:
        half = (len(lines) + 1) // 2
        lines = [left + right for left, right in zip_longest(lines[:half], lines[half:], fillvalue="")]
    return "\n".join(line.rstrip() for line in [*lines, "H       show, hide these keys"])
