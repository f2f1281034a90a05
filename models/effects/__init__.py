"""Physics beyond ideal geometry: one short file per term (see ``truepose.models.effects.base``)."""
