"""From the photocurrent of a Fabry-Perot cavity to the change of its length."""
