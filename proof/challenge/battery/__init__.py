"""What is run before and after every change of the engine: simulated machines of three kinds, real recordings in parts."""
