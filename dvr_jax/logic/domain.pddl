; The symbolic domain of Deep Visual Reasoning: two arms grasp objects and place them.
;
; How to extend it: add an `:action`; the grounder picks it up, and its name is what the program calls the operator.
; An operator also needs its geometric meaning, registered by operator name where sequences are transcribed.
; Preconditions and effects may use `and`, `not` of a fact, `forall` and (in preconditions) `=`. Nothing else.
; Effects delete first and add afterwards, as everywhere in PDDL.
;
; Whoever grounds this file supplies the arms, the objects of the scene (type `movable`; PDDL keeps the word `object`
; for itself), the initial facts (every object `on` the table) and the goal (the goal object `on` the goal).

(define (domain deep-visual-reasoning)
  (:requirements :strips :typing :equality :negative-preconditions :universal-preconditions :conditional-effects)

  (:types arm face movable support)

  (:constants
    face0 face1 face2 face3 - face   ; side faces of an object, outward normals +x, +y, -x, -y in the object's frame
    table goal - support)            ; the table top, and the goal region on it

  (:predicates
    (holding ?arm - arm ?item - movable)
    (on ?item - movable ?support - support))

  ; The arm's hand is empty. The object may stand anywhere, or be held by another arm: then that arm hands it over.
  (:action grasp
    :parameters (?arm - arm ?face - face ?item - movable)
    :precondition (forall (?held - movable) (not (holding ?arm ?held)))
    :effect (and
      (forall (?giver - arm) (not (holding ?giver ?item)))
      (forall (?support - support) (not (on ?item ?support)))
      (holding ?arm ?item)))

  ; Any object may be placed on the goal region, and any number of them: whether they fit is a question of geometry.
  (:action place
    :parameters (?arm - arm ?item - movable ?support - support)
    :precondition (holding ?arm ?item)
    :effect (and
      (not (holding ?arm ?item))
      (on ?item ?support)))
)
