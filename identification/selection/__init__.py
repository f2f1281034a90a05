"""Forward selection with evidence, for missing effects and for movements alike: its steps, its scales, its gains."""
