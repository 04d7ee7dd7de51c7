"""What can be added to a training from outside of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trainers.training_run import TrainingRun


class Callback:
    """Is called as a training goes; every method is optional.

    With several processes each has callbacks of its own, all of which are called;
    `TrainingRun.is_first` is true in one of them. What a callback raises ends the training,
    once what was learnt is saved.

        class StopEarly(trainers.Callback):
            def on_iteration(self, training):
                if training.figures[0]["ppo/entropy"] < 0.5:
                    training.stop()

        trainers.train("paper/k10-fdd", "runs/mine", callbacks=[StopEarly()])
    """

    def on_start(self, training: TrainingRun) -> None:
        """Before the first iteration; of a resumed training, before the first that is left."""

    def on_iteration(self, training: TrainingRun) -> None:
        """After each iteration: `training.figures` has what there is to log."""

    def on_checkpoint(self, training: TrainingRun) -> None:
        """After each save, the last one included."""

    def on_end(self, training: TrainingRun) -> None:
        """At the end, however it came: `training.failure` is what has ended it, if anything.

        Called whenever `on_start` was. Where all steps were taken, or a callback has stopped the
        training, `training.evaluations` has the final evaluation of each policy.
        """
