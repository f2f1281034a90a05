"""What is made of a finished examination, and of its cases; each is a command, run from a clone.

python -m challenge.studies.page DIR [PAGE]                 # the published table, into challenge/results/examination.md
python -m challenge.studies.levels_by_stratum DRAWN DIR     # place, driver and law, inside the catalogue and outside
python -m challenge.studies.reliability DIR [FIGURE]        # stated probabilities against shares that were right
python -m challenge.studies.prior_expectations DRAWN ...    # the prior's numbers beside what posteriors say of them
python -m challenge.studies.practice CASES RESULTS          # cases of a third simulator, with a scorer of its own
"""
