"""What each explanation would do to a recording: candidates of the catalogue, and their signatures at a fit."""
