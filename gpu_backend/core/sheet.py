"""Blocks of threads over the rows and columns of a sheet."""

BLOCK = (32, 8)  # threads along a row, down the columns
MAX_BLOCKS_DOWN = 65535  # CUDA's limit of a grid's second dimension
