"""The contact problem (Sec. 2.3), the paper's iteration, and numbers of solutions.

- *Problem.* `distance` has the undeformed distance h, and `bounds` the bounds of the pressure. `state` has the contact
  set C, the pressure p and the displacement u, and the steps of Sec. 4.1 on them. `loops` and `bounds_loops` are
  their compiled loops.
- *Loading.* `loading_input` has the table of the loadings, and makes them from numbers. `loading` and `prescribed_load`
  have their classes. `approach_search` finds the approach of a loading that does not determine it.
- *Hardness.* `plastic_load` finds the approach to a load, `full_plasticity` is the solution under the largest load.
- *Iteration.* `active_set` makes the steps of Sec. 4.1 in order, with any KSP. `stopping` has the test (5.1).
  `full_multigrid` is Sec. 4.3. `grid_sequence` is the loop over the grids, which all nested iterations share.
  `periodic_state` and `full_contact` are used on periodic patches only.
- *Result.* `certificate` proves an error bound of the pressure. `measures` and `contact_moments` compute load, area and
  other numbers. `grid_errors` estimates the errors of these numbers due to the cell size. `history` records each
  iteration.
"""
