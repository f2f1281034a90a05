"""The kinds of slips, by what they are about: every function yields what might have been meant instead."""
