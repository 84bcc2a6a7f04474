"""Wheel load from accelerometers and deflections: Filipozzi et al. 2021 and what goes beyond."""
