"""Parts that can be deleted: nothing outside this folder imports them."""
