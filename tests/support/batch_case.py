"""What the tests of the batch share beside the trials of it (experiments/batch_trials.py)."""


class Silent:
    """Hears how far a batch is: every stage once, with its share; `then` is called after the first group that ends."""

    def __init__(self, then=None):
        self.heard, self.then = [], then

    def __call__(self, stage, share):
        if not self.heard or self.heard[-1][0] != stage:
            self.heard.append((stage, share))
            if self.then is not None and len(self.heard) == 2:
                self.then()
