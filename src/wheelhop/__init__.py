"""wheelhop: differentiable filtering for vehicles in JAX.

Importing it sets no global JAX flag; float32 and float64 both work.
"""

__version__ = "0.1.0"
