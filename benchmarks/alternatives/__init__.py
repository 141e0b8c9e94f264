"""What a laboratory would do in place of a diagnosis, on the campaigns of a blind trial.

    drillenv prove --out DIR --seed 7
    python -m benchmarks.alternatives --trial DIR --json alternatives.json

On each campaign: the paper's model with all its constants fitted, with and without the lab's tolerances; a sparse
regression of the force balances (PySINDy) over the library's own equations; a Gaussian process of what the paper's
model leaves. All predict the recordings that the diagnosis held out, and are marked by the rules of the trial. A run
that was stopped goes on.
"""
