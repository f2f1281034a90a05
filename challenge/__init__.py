"""The blind examination of the diagnosis engine: cases by an independent simulator, an exam, a score."""
