"""What a machine's sensors should read: predictions with exact derivatives, and simulated recordings."""
