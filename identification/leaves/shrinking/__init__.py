"""Linear estimators that give up a little of their unbiasedness where columns are nearly dependent: liu, ridge, pcr."""
