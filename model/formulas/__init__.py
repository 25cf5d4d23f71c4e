"""Point-wise physics, one file per topic: the only place where a step's floating-point arithmetic is written.

A formula is a function of its module that takes and returns scalars, so that both backends inline it into their loops.
Each backend compiles it in the variant that it needs (model/base/variant.py): in float32 or float64, with the features of
a scene, and in `exact` math on CUDA with products that are rounded. Integer arithmetic is an `integer_formula`.
"""
