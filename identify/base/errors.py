"""Errors a user can mend: one sentence each, what was found, what was expected, what to do."""


class IdentifyError(Exception):
    """Base of every error of this package that a user can mend; the text is the whole message."""


class SceneError(IdentifyError):
    """The scene (rig, effects, parameters, logs) does not say something that can be worked with."""


class FitError(IdentifyError):
    """The fit cannot be set up from these logs and this scene."""


class SimulationError(IdentifyError):
    """The simulation was asked for something the model refuses; the text names it."""


class DocumentError(IdentifyError):
    """A document (of a result, say) lacks something, or holds something of another kind than expected."""
