"""What a fleet of machines says together: how often which physics is missing, how large it is, and what is odd."""
