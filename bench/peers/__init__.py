"""What a user could pick instead of this lab, to be measured beside it on the same scene: one file a peer.

The contract is in base.py, the list of peers in registry.py, the measuring in bench/peers/sweep.py. Nothing here is
imported by the lab's own backends, and every peer is optional: one that cannot run says why.
"""
