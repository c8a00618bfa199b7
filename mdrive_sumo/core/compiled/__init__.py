"""The compiled layer: C twins of functions on which an episode spends its time, with the same bits.

A Python file with twins has a C file beside it, with the same names in the same order. The Python text is the
reference: it says what is computed, tests compare both, and it is used where the layer is missing.
docs/compiled-layer.md says how to write a twin; `hatch_build.py` compiles all of them into one extension module.
"""

from mdrive_sumo.core.compiled.loader import REFERENCES, format_notice, layer, problem, twin

__all__ = ["REFERENCES", "format_notice", "layer", "problem", "twin"]
