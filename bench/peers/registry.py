"""The peers there are, in the order in which they are measured and drawn."""

from __future__ import annotations

from bench.peers.base import Peer
from bench.peers.cpp_openmp import CppOpenmp, CppOpenmpBlocked
from bench.peers.cuda_cpp import CudaCpp
from bench.peers.cuda_cpp_blocked import CudaCppBlocked
from bench.peers.numpy_grid import NumpyGrid
from bench.peers.warp_grid import WarpGrid

OURS = "softlab"  # the lab itself, in the `peer` field of what was measured beside peers
PEERS: tuple[Peer, ...] = (
    CppOpenmp(),
    CppOpenmpBlocked(),
    WarpGrid("cpu"),
    NumpyGrid(),
    CudaCpp(),
    CudaCppBlocked(),
    WarpGrid("gpu"),
)


def label(name: str) -> str:
    """How figures and tables call a peer of the store, also one that is no longer registered."""
    return next((peer.label for peer in PEERS if peer.name == name), name)
