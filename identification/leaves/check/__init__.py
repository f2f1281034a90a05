"""The gate before a fit: does this recording belong to this machine file, and if not, which slip would explain it?"""
