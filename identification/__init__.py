"""What recordings say about a machine: estimates, their uncertainty, and the physics that is missing."""
