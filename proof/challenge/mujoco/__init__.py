"""Cases whose physics is MuJoCo's: arms of public model packages, with springs, gaps and friction built into them."""
