; The arm's hand is empty. The object may stand anywhere, or be held by another arm: then that arm hands it over.
(:action grasp
  :parameters (?arm - arm ?face - face ?item - movable)
  :precondition (forall (?held - movable) (not (holding ?arm ?held)))
  :effect (and
    (forall (?giver - arm) (not (holding ?giver ?item)))
    (forall (?support - support) (not (on ?item ?support)))
    (holding ?arm ?item)))
