; The symbolic domain of Deep Visual Reasoning: two arms grasp objects and place them.
;
; This file is the header: types, constants and predicates. Each operator has its own text, one `(:action ...)`, and the
; domain is the header with the texts of all operators in it. The name of an action is the name of its operator.
; Preconditions and effects may use `and`, `not` of a fact, `forall` and (in preconditions) `=`. Nothing else.
; Effects delete first and add afterwards, as everywhere in PDDL.
;
; The program that grounds the domain supplies the arms, the objects of the scene, the initial facts (every object `on`
; the table) and the goal (the goal object `on` the goal). Objects have the type `movable`, because PDDL keeps the word
; `object` for itself.

(define (domain deep-visual-reasoning)
  (:requirements :strips :typing :equality :negative-preconditions :universal-preconditions :conditional-effects)

  (:types arm face movable support)

  (:constants
    face0 face1 face2 face3 - face   ; side faces of an object, outward normals +x, +y, -x, -y in the object's frame
    table goal - support)            ; the table top, and the goal region on it

  (:predicates
    (holding ?arm - arm ?item - movable)
    (on ?item - movable ?support - support))
)
