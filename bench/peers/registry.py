"""List of the peers, in the order in which they are measured and drawn."""

from __future__ import annotations

from softlab.bench.peers.bars.fem import WarpFem
from softlab.bench.peers.bars.lab import LabTetrahedra
from softlab.bench.peers.bars.newton import NewtonTetrahedra
from softlab.bench.peers.base import Peer
from softlab.bench.peers.cpp_openmp import CppOpenmp, CppOpenmpBlocked
from softlab.bench.peers.cpp_tetrahedra import CppTetrahedra
from softlab.bench.peers.cuda_cpp import CudaCpp
from softlab.bench.peers.cuda_cpp_blocked import CudaCppBlocked
from softlab.bench.peers.cuda_cpp_cloth import CudaCppCloth
from softlab.bench.peers.lab_xpbd import LabXpbd
from softlab.bench.peers.newton_rigid import NewtonRigid
from softlab.bench.peers.newton_sheet import NewtonSemiImplicit, NewtonVbd, NewtonXpbd
from softlab.bench.peers.numpy_grid import NumpyGrid
from softlab.bench.peers.warp_cloth import WarpCloth
from softlab.bench.peers.warp_grid import WarpGrid
from softlab.bench.peers.warp_xpbd import WarpXpbd

OURS = "softlab"  # the lab itself, in the `peer` field of measurements with peers


def _of_warp(backend: str) -> tuple[Peer, ...]:
    return (
        WarpGrid(backend), WarpCloth(backend), WarpXpbd(backend), NewtonSemiImplicit(backend), NewtonXpbd(backend, 10),
        NewtonVbd(backend, 10), NewtonVbd(backend, 50), LabXpbd(backend, 2), LabXpbd(backend, 10),
        NewtonRigid(backend, "XPBD", 10), NewtonRigid(backend, "VBD", 10), NewtonRigid(backend, "Steel"),
        NewtonTetrahedra(backend, "SemiImplicit"), NewtonTetrahedra(backend, "VBD", 4, 10),
        NewtonTetrahedra(backend, "VBD", 10, 50), NewtonTetrahedra(backend, "XPBD", 30, 1),
        NewtonTetrahedra(backend, "XPBD", 10, 10), WarpFem(backend),
        *(LabTetrahedra(backend, "xpbd", substeps, 1) for substeps in (30, 128, 512)),
        LabTetrahedra(backend, "vbd", 4, 30),
    )  # fmt: skip


PEERS: tuple[Peer, ...] = (
    CppOpenmp(), CppOpenmpBlocked(), CppTetrahedra(), *_of_warp("cpu"), NumpyGrid(), CudaCpp(), CudaCppBlocked(),
    CudaCppCloth(), *_of_warp("gpu"),
)  # fmt: skip


def label(name: str) -> str:
    """Return the name of a peer of the store in figures and tables, also of one that is no longer registered."""
    return next((peer.label for peer in PEERS if peer.name == name), name)
