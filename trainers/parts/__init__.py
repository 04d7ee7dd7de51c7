"""Parts of a training: networks and optimizers. They register themselves and import no torch."""
