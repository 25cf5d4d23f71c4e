"""Programs that a user could choose instead of this lab, measured on the same scenes: one file per peer.

base.py has the interface, registry.py the list of peers, bench/peers/sweep.py the measurement. The lab's own backends
import nothing from here, and every peer is optional: one that cannot run reports the reason.
"""
