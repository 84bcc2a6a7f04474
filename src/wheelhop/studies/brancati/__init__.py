"""Brancati & Tufano 2022: every table and figure, on our own plant."""
