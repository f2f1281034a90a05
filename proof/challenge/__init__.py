"""The blind examination of the diagnosis engine; stands beside the product and is not installed: ``python -m challenge``.

simulator/, mujoco/     machines that measure: own physics, of numpy and scipy; arms of public packages in MuJoCo
draw                    ``schedule`` (which case is of which stratum), ``setup``, ``strata``, ``real_like``, ``nulls`` and
                        ``sizing`` (what is wrong, and how large), ``cases``, ``keys`` (what is true, and what else is as
                        good: ``rivals``, ``references``, ``empirical``), ``solutions`` (the key as a file)
sit                     ``examine`` writes the cases and starts the engine on each, ``examinee`` runs it there
score                   ``findings`` and ``predictions`` (what was answered), ``score`` (one case), ``headline``, ``details``
                        and ``level_figures`` (all cases), ``report`` (the table, as text and as data)
studies/, results/      what is made of finished examinations, and their published tables
"""
