"""The kinds of slips, one module each: every one yields what might have been meant instead."""
