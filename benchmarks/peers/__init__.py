"""Other programs that do the benchmark's work, so that rates compare within one process.

Every module builds its peer once and hands back something to call as often as wanted; it prints
nothing and times nothing but its own compilation. `compiled` is the practical limit, `idiomatic`
what plain JAX gives, and the libraries are skipped with a reason where they are not installed.
"""
