"""A slot of a single environment, written as straight-line Python."""
