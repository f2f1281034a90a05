"""What a machine is, symbolically (CasADi SX): mechanisms, sensors, effects. No data, no fitting."""
