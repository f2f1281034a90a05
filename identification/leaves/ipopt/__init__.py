"""The solver ``ipopt``: a fit within bounds, with the passive joints as unknowns."""
