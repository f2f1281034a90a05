"""Where right pairs come from: simulators, none of which uses the library's own model of a machine."""
