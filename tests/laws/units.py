"""The tables of a scene in other units of length, time and mass."""

from __future__ import annotations

from typing import Any

# exponents of (length, mass, time) of the fields that rows have; what is not here has no unit
LENGTHS = (
    "spacing", "rest_length", "particle_spacing", "sides", "origin", "edge", "size", "rest_distance", "distance", "scale",
    "link_radius",
)  # fmt: skip
UNITS: dict[str, tuple[int, int, int]] = dict.fromkeys(LENGTHS, (1, 0, 0)) | {
    "mass": (0, 1, 0),
    "stiffness": (0, 1, -2),
    "link_stiffness": (0, 1, -2),
    "cluster_stiffness": (0, 0, -2),
    "plastic_creep": (0, 0, -1),
    "young_modulus": (-1, 1, -2),
    "density": (-3, 1, 0),
    "dt": (0, 0, 1),
    "velocity": (1, 0, -1),
    "separation_speed": (1, 0, -1),
}
OF_KINDS: dict[tuple[str, str], tuple[int, int, int]] = {
    ("bending", "isometric"): (2, 1, -2),  # J: of a hinge
    ("bending", "dihedral"): (2, 1, -2),
    ("volume", ""): (-1, 1, -2),  # Pa: a bulk modulus
    ("soft_sheet", ""): (-2, 1, 0),  # kg/m^2
}
DEFAULTS: dict[str, dict[str, Any]] = {  # with a unit, that kernels read where a scene does not name them
    "rigid_body": {"density": 1000.0},
    "soft_body": {"density": 1000.0},
    "soft_lattice": {"density": 1000.0},
    "tetrahedral_body": {"density": 1000.0},
    "fluid": {"density": 1000.0},
    "contact": {"separation_speed": 3.0},
}


def in_units(tables: dict[str, Any], length: float, time: float, mass: float) -> dict[str, Any]:
    """The same scene, its numbers times powers of the three scales."""

    def factor(exponents: tuple[int, int, int]) -> float:
        return length ** exponents[0] * mass ** exponents[1] * time ** exponents[2]

    def scaled(value: Any, by: float) -> Any:
        return [scaled(one, by) for one in value] if isinstance(value, list | tuple) else value * by

    def table_in_units(name: str, table: dict[str, Any]) -> dict[str, Any]:
        kind = table.get("kind", name)
        result: dict[str, Any] = {}
        for field, value in (DEFAULTS.get(kind, {}) | table).items():
            exponents = UNITS.get(field)
            if kind == "fluid" and field == "density" and table.get("dimensions") == 2:
                exponents = (-2, 1, 0)  # its layer stays a metre thick
            if field == "stiffness" or (field == "density" and kind == "soft_sheet"):
                exponents = OF_KINDS.get((kind, table.get("model", "")), exponents)
            if isinstance(value, dict):
                result[field] = table_in_units(field, value)
            else:
                result[field] = value if exponents is None else scaled(value, factor(exponents))
        if kind == "soft_sheet" and "sides" not in result["shape"]:
            result["shape"] = result["shape"] | {"scale": length}
        return result

    return {name: table_in_units(name, table) for name, table in tables.items()}
