"""Worked examples for the opening prompt: short episodes in other scenes.

A test runs them in the engine: every return is what the tool returns, to the digits shown.
"""

EXAMPLES = (
    """## A dropped ball

Task: with which acceleration does object_1, let go at rest, fall?

Reasoning: time must pass before a change of velocity exists. I let 0.5 s pass and read the velocity.
Calls: step(duration=0.5); get_velocity(object_id="object_1")
Returns: {"sim_time":0.5,"steps":100,"lab_time_left":3599.5,"calls_left":null,"results":null}; \
{"sim_time":0.5,"velocity":[0.0,0.0,-4.905],"angular_velocity":null}
Reasoning: it started at rest, so a = 4.905 / 0.5 = 9.81 m/s² downward. I check with the last time step.
Calls: get_acceleration(object_id="object_1")
Returns: {"sim_time":0.5,"x":0.0,"y":0.0,"z":-9.81}
Reasoning: both agree.
Calls: answer(answer=9.81)""",
    """## A pushed box

Task: what is the mass of object_1, which glides without friction?

Reasoning: a known force and the acceleration it causes give the mass.
Calls: apply_force(object_id="object_1", force_vector=[6, 0, 0]); step(duration=0.1); \
get_acceleration(object_id="object_1")
Returns: {"sim_time":0.0,"status":"force set","object_id":"object_1","force":[6.0,0.0,0.0]}; \
{"sim_time":0.1,"steps":20,"lab_time_left":3599.9,"calls_left":null,"results":null}; \
{"sim_time":0.1,"x":2.4,"y":0.0,"z":0.0}
Reasoning: m = F / a = 6 / 2.4 = 2.50 kg.
Calls: answer(answer=2.50)""",
    """## A sphere on a ramp

Task: does object_1 roll down the ramp without slipping (1) or does it slip (2)? Its radius is 0.1 m.

Reasoning: rolling means that speed and spin agree: v = ω R. With E and L computed for the same mass, ω = 2 E / L.
Calls: step(duration=0.5); get_velocity(object_id="object_1"); get_rotational_energy(object_id="object_1", mass=1); \
get_angular_momentum(object_id="object_1", mass=1)
Returns: {"sim_time":0.5,"steps":100,"lab_time_left":3599.5,"calls_left":null,"results":null}; \
{"sim_time":0.5,"velocity":[1.681,0.0,-1.261],"angular_velocity":null}; \
{"sim_time":0.5,"rotational_energy":0.8844}; {"sim_time":0.5,"angular_momentum":{"x":0.0,"y":0.08412,"z":0.0}}
Reasoning: ω = 2 · 0.8844 / 0.08412 = 21.03 rad/s and ω R = 2.103 m/s. The speed is √(1.681² + 1.261²) = 2.101 m/s. \
They agree.
Calls: answer(answer=1)""",
)
