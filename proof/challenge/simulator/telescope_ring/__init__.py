"""The telescope in full: a ring of beam finite elements around a rigid hub, bent by circular flexures.

The equilibrium is solved; the effect catalogue of truepose plays no part. mm, N, rad (a pose sensor reads deg).
"""
