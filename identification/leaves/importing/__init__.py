"""Tables of instruments and controllers, turned into recordings."""
