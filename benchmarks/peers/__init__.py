"""Comparison with public contact solvers, to the same checked accuracy.

Run by ``run/bench-peers``; see there. Every package lives in an environment of its own and is driven by a small
script, ``adapters/*_adapter.py`` (see ``adapters/protocol.py``). All get the same array of distances; all pressures
are checked here by a plain product.
"""
