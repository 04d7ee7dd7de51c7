"""AUVs that charge underwater sensor nodes by sound and collect their data."""

__version__ = "0.1.0"
