; Any object may be placed on the goal region, and any number of them: whether they fit is a question of geometry.
(:action place
  :parameters (?arm - arm ?item - movable ?support - support)
  :precondition (holding ?arm ?item)
  :effect (and
    (not (holding ?arm ?item))
    (on ?item ?support)))
