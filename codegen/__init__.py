"""Native code from a symbolic model: the controller's C."""
