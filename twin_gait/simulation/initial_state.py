"""Initial state: record of an episode at tick 0."""

import math
import reprlib
from dataclasses import replace

from twin_gait.control import gait_controller as ccu
from twin_gait.control.controller import controller_error, require_whole_numbers
from twin_gait.control.joint_board import BoardState, CommandLimits, Limits, SamplingConfig
from twin_gait.control.supervisor import NO_POSTURE, ModeCommand, Supervisor
from twin_gait.core.actuator import Motor
from twin_gait.core.contact import ContactState
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, ImpedanceSetpoint, new_encoder
from twin_gait.core.estimation import PERCEPTION_CAPACITY, first_order_gain, new_delay_line
from twin_gait.core.faults import FaultRecord
from twin_gait.core.guards import CompiledComparison, GuardNode, GuardProgram, TransitionRule
from twin_gait.core.inertial import TrunkUnit
from twin_gait.core.own_gait import OwnGait, OwnJoint, OwnLeg
from twin_gait.core.plant import ImposedMotion
from twin_gait.core.safety import Bounds
from twin_gait.experiment.bus import bus_messages
from twin_gait.gait.modes import Mode, ModeTable
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.kernels.generated import KernelBodies, body_values
from twin_gait.network.bus import cyclic_messages, new_bus
from twin_gait.network.messages import MEASUREMENT_SUFFIX, SETPOINT_SUFFIX
from twin_gait.parameters.network import NetworkParameters
from twin_gait.parameters.quantities import from_attributes
from twin_gait.simulation import episode
from twin_gait.simulation.record import ABSENT, Record, find_float, is_record, pad_phases
from twin_gait.simulation.simulation_setup import (
    NEVER,
    OwnGaitRows,
    SimulationSetup,
    fault_records,
    phase_timeout_ticks,
    start_phase,
    to_ticks,
)
from twin_gait.vocabulary import LEAN, LOWER, REACH_BACK, RISE, SIT, STRAIGHTEN, JointName, Side
from twin_gait.worlds.arm_policy import LEANING, REACHING_BACK, RISING, SITTING, SITTING_DOWN

MOST_SWITCHES_PER_SECOND = 200
MOST_FAULTS = 16  # Largest number of faults that can be injected; a run without faults has room for them.
# Lists are padded to a multiple of this length, so that gait tables of similar size share one compiled loop.
_CAPACITY = 16
# State of sitting on a chair that the wearer perceives in a phase.
CHAIR_CODES = {
    SIT: SITTING,
    LEAN: LEANING,
    RISE: RISING,
    STRAIGHTEN: RISING,
    REACH_BACK: REACHING_BACK,
    LOWER: SITTING_DOWN,
}
_DELAY_PADDING = 32  # Ring buffers of the bus are padded to a multiple of this length, for the same reason.


def new_episode(setup: SimulationSetup, bodies: KernelBodies) -> episode.Episode:
    """Return the episode of a simulation setup at tick 0.

    Its parts may be objects of the world, and one object may be in several places; a copy is needed before it
    is changed. ``bodies``: bodies for which the kernels of plant and controller are generated.
    """
    experiment, world = setup.experiment, setup.world
    n, stepping, phases = len(world.start_q), experiment.resolved_integration, setup.table.phases
    most_switches = max(100, int(MOST_SWITCHES_PER_SECOND * experiment.duration))
    faults = fault_records(setup)
    legs = world.model.legs.items()
    ankles = [world.model.index(side, JointName.ANKLE) for side, leg in legs if leg.ankle is not None]
    passive = [world.model.index(side, joint) for side, joint in setup.passive]
    return from_attributes(
        episode.Episode,
        world,
        step=stepping.step,
        substeps=stepping.substeps,
        gravity=experiment.plant.gravity,
        fall_height=float(world.fall_height),
        watching=experiment.control.safety.enabled,
        has_wearer_torques=not all(limb.condition.is_torque_free for limb in setup.limbs),
        has_inertial_unit=setup.inertial,
        first_fault=min((fault.start_tick for fault in faults), default=NEVER),
        q=world.start_q.tolist(),
        v=world.start_v.tolist(),
        a=[0.0] * n,
        motor=[0.0] * n,
        external=[0.0] * n,
        voluntary=[0.0] * n,
        passive_moment=[0.0] * n,
        torque=[0.0] * n,
        rotors=[plant.armature for plant in world.plant],
        integrator=episode.IntegratorBuffers(*([0.0] * n for _ in range(4))),
        bodies=body_values(bodies.bodies, bodies.points),
        rates=SamplingConfig(
            TICK, setup.fast_gain, experiment.sensors.decimation, setup.table.blending.law.code
        ),
        supply=_supply(setup),
        limits=build_limits(setup, setup.experiment.network),
        controller=_controller(setup, body_values(bodies.control_bodies)),
        joints=[_joint(setup, number) for number in range(len(setup.joints))],
        feet=[episode.FootState() for _ in setup.wearer_sides],
        soles=[setup.wearer_sides.index(side) for side in setup.sides],
        network=ABSENT if experiment.network is None else _network(setup, experiment.network),
        limbs=setup.limbs,
        own_gait=ABSENT if setup.own_gait is None else _own_gait(setup, setup.own_gait),
        ankles=ankles,
        passive=passive,
        ground=world.ground(),
        points=[ContactState() for _ in range(max(len(bodies.points), 1))],
        imposed_motion=world.imposed_motion or ImposedMotion(),
        braces=[] if world.braces is None else world.braces.braces,
        braced=[*(joint.coordinate for joint in setup.joints), *passive],
        faults=faults or [FaultRecord(0, -1, NEVER, 0.0)] * MOST_FAULTS,
        requests=_requests(setup),
        trunk_unit=ABSENT if world.model.pitch_index is None else _trunk_unit(setup),
        swing_phases=[float(setup.table.is_swing(name)) for name in phases if world.arms],
        chair_phases=[CHAIR_CODES.get(name, 0.0) for name in phases if world.arms or world.seat is not None],
        recording=episode.Recording(most_switches, len(setup.noise)),
    )


def _supply(setup: SimulationSetup) -> episode.Supply:
    battery, electronics = setup.experiment.plant.battery, setup.experiment.plant.electronics
    power = electronics.constant_power + len(setup.joints) * electronics.inverter_power
    voltage, resistance = battery.voltage, battery.internal_resistance
    return episode.Supply(voltage, resistance, power, electronics.regeneration, bus_voltage=voltage)


def build_limits(setup: SimulationSetup, network: NetworkParameters | None) -> Limits:
    """Return the limits of boards and gait controller; without a network, messages have no timeout."""
    control = setup.experiment.control
    safety = control.safety
    monitored = network if safety.enabled else None
    return Limits(
        phase_ticks=phase_timeout_ticks(setup),
        frozen_load_ticks=to_ticks(safety.frozen_load_time),
        controller_timeout=NEVER if monitored is None else to_ticks(monitored.board_timeout),
        board_timeout=NEVER if monitored is None else to_ticks(monitored.ccu_timeout),
        lowering_ticks=to_ticks(safety.lowering_time),
        hold_damping=safety.hold_damping,
    )


def _controller(setup: SimulationSetup, bodies: list[float]) -> ccu.ControllerState:
    experiment, control = setup.experiment, setup.experiment.control
    supply, settings, modes = experiment.plant.battery.voltage, control.safety, experiment.modes
    gain, memory = control.inertia_compensation, setup.controller.initial_memory(setup.plan)
    if not is_record(memory):
        expected = "a memory that is a dataclass with slots, of numbers, such dataclasses and lists of them"
        raise controller_error(setup.controller.name, expected, reprlib.repr(memory))
    require_whole_numbers(setup.controller.name, find_float(memory))
    q, a, gravity, inertia = ([0.0] * setup.control_model.nv for _ in range(4))
    legs = [_leg(setup, number) for number in range(len(setup.sides))]
    return ccu.ControllerState(
        joints=[
            _controlled_joint(setup, number, legs[number // setup.joints_per_leg].phase)
            for number in range(len(setup.joints))
        ],
        legs=legs,
        program=_padded(setup.program),
        signals=setup.table.to_si({}),
        supply=ccu.SupplyMonitor(
            supply, settings.min_voltage_share * supply, low_ticks=to_ticks(settings.voltage_time)
        ),
        model=ccu.ControlModel(bodies, experiment.plant.gravity, q, a, gravity, inertia, gain),
        memory=memory,
        supervisor=ABSENT if modes is None else _supervisor(setup, modes),
    )


def _controlled_joint(setup: SimulationSetup, number: int, phase: int) -> ccu.ControlledJoint:
    joint, control = setup.joints[number], setup.experiment.control
    leg, position = divmod(number, setup.joints_per_leg)
    first = COLUMNS_PER_JOINT * position
    rows = setup.phase_rows[leg, :, first : first + COLUMNS_PER_JOINT].tolist()
    setpoints = [ImpedanceSetpoint(*row) for row in rows]
    return ccu.ControlledJoint(
        model_index=joint.control_coordinate,
        setpoints=pad_phases(setpoints),
        blend_start=setpoints[phase],
        blended=setpoints[phase],
        target=control.target_torque.get(joint.joint, 0.0),
        ticks_since_message=-setup.bus_delay,
    )


def _leg(setup: SimulationSetup, number: int) -> ccu.ControlledLeg:
    side = setup.sides[number]
    phase = start_phase(setup.table, setup.world.initial_phases[side])
    shares = setup.phase_rows[number, :, -1].tolist()
    return ccu.ControlledLeg(
        phase=phase,
        debounce=[0] * _capacity(setup.program.n_transitions),
        gravity_shares=pad_phases(shares),
        gravity_start=shares[phase],
        gravity=shares[phase],
        blend_ticks=_blend_ticks(setup.table, side),
        frozen_speed=setup.experiment.control.safety.frozen_speed,
    )


def _blend_ticks(table: GaitTable, side: Side) -> list[int]:
    return pad_phases([table.blend_ticks(phase) for phase in table.phases_of(side).values()])


def _own_gait(setup: SimulationSetup, rows: OwnGaitRows) -> OwnGait:
    """Return the wearer's own gait, with the true angles and no load as what the wearer perceived before."""
    own, start_q = setup.experiment.own_gait, setup.world.start_q
    assert own is not None
    phases = [start_phase(rows.table, setup.world.initial_phases[side]) for side in setup.wearer_sides]
    per_leg = len(own.joints)
    joints = []
    for number, (_, _, coordinate) in enumerate(rows.joints):
        leg, position = divmod(number, per_leg)
        columns = slice(COLUMNS_PER_JOINT * position, COLUMNS_PER_JOINT * (position + 1))
        setpoints = [ImpedanceSetpoint(*row) for row in rows.phase_rows[leg][:, columns].tolist()]
        angle = float(start_q[coordinate + setup.world.wearer_offset])
        joints.append(
            OwnJoint(
                index=coordinate,
                highest_torque=rows.highest_torques[number],
                setpoints=pad_phases(setpoints),
                blend_start=setpoints[phases[leg]],
                blended=setpoints[phases[leg]],
                angle_line=new_delay_line(own.delay_ticks, angle, PERCEPTION_CAPACITY),
                velocity_line=new_delay_line(own.delay_ticks, 0.0, PERCEPTION_CAPACITY),
            )
        )
    legs = [
        OwnLeg(
            phase=phase,
            debounce=[0] * _capacity(rows.program.n_transitions),
            blend_ticks=_blend_ticks(rows.table, side),
            load_line=new_delay_line(own.delay_ticks, 0.0, PERCEPTION_CAPACITY),
        )
        for phase, side in zip(phases, setup.wearer_sides, strict=True)
    ]
    return OwnGait(
        joints=joints,
        legs=legs,
        program=_padded(rows.program),
        signals=rows.table.to_si({}),
        blend_law=rows.table.blending.law.code,
        first_noise=setup.noise.shape[1] - len(rows.joints),
        torque=[0.0] * len(start_q),
    )


def _supervisor(setup: SimulationSetup, modes: ModeTable) -> Supervisor:
    table, initial = setup.table, setup.experiment.initial_mode
    modes = replace(modes, joints=table.joints)  # the joints determine the order of the signals
    program = compile_guards(modes)

    def mode_command(mode: Mode) -> ModeCommand:
        posture = NO_POSTURE if mode.posture is None else table.phase_index(mode.posture)
        return ModeCommand(posture, float(mode.walk), float(mode.step))

    return Supervisor(
        program=_padded(program),
        modes=[mode_command(mode) for mode in modes.phases.values()],
        hold=modes.phase_index(modes.hold),
        swing=sum(1 << index for index, name in enumerate(table.phase_names) if table.is_swing(name)),
        signals=modes.to_si({}),
        debounce=[0] * _capacity(program.n_transitions),
        mode=0 if initial is None else modes.phase_index(initial),
    )


def _padded(program: GuardProgram) -> GuardProgram:
    """Return a guard program with padded lists, so that tables of similar size share one loop."""
    return replace(
        program,
        minimum_ticks=pad_phases(program.minimum_ticks),
        transitions=_padded_list(program.transitions, TransitionRule(-1, 0, 0, 0, 0, 0)),
        nodes=_padded_list(program.nodes, GuardNode(0, 0)),
        comparisons=_padded_list(program.comparisons, CompiledComparison(0, 0, 0.0, 0.0, 0.0)),
    )


def _padded_list(entries: list[Record], blank: Record) -> list[Record]:
    return entries + [blank] * (_capacity(len(entries)) - len(entries))


def _capacity(count: int) -> int:
    return max(1, -(-count // _CAPACITY)) * _CAPACITY


def _joint(setup: SimulationSetup, number: int) -> episode.Joint:
    joint, experiment = setup.joints[number], setup.experiment
    actuator, inverter = setup.actuator(joint), experiment.plant.electronics.inverter_resistance
    motor = from_attributes(Motor, actuator, resistance=actuator.resistance + inverter)
    angle = float(setup.world.start_q[joint.coordinate] + setup.offset[number])
    counts = experiment.sensors.encoder_counts * actuator.gear_ratio
    resolution = 0.0 if experiment.sensors.ideal else 2.0 * math.pi / counts
    return episode.Joint(
        index=joint.coordinate,
        board=BoardState(
            encoder=new_encoder(resolution, angle, experiment.sensors.window),
            motor=motor,
            friction_model=experiment.control.friction_model[joint.joint],
            limits=from_attributes(CommandLimits, experiment.control.limits[joint.joint]),
            bounds=_bounds(setup, number),
            # The first frame may arrive later by this number of ticks.
            ticks_since_message=-setup.bus_delay,
        ),
        motor=motor,
        # A command that leaves the line takes effect in the next tick, so the line is one tick shorter.
        line=new_delay_line(max(0, experiment.control.delay_ticks - 1)),
        reading=angle,
    )


def _bounds(setup: SimulationSetup, number: int) -> Bounds:
    """Return the bounds of the safety monitor for a joint."""
    joint, control, model = setup.joints[number], setup.experiment.control, setup.control_model
    settings, motor, limits = control.safety, setup.actuator(joint), control.limits[joint.joint]
    lower, upper = control.joint_range(model, joint.side, joint.joint)
    continuous = motor.continuous_torque / (motor.torque_constant * motor.gear_ratio)
    cooling = min(1.0, TICK / settings.thermal_time_constant)
    resistance = motor.resistance + setup.experiment.plant.electronics.inverter_resistance
    return from_attributes(
        Bounds,
        settings,
        lower=lower,
        upper=upper,
        highest_speed=settings.speed_share * control.highest_speed(model, joint.side, joint.joint),
        stop_distance_factor=0.5 / settings.stopping_deceleration,
        frozen_ticks=to_ticks(settings.frozen_time),
        model_gain=min(1.0, TICK / settings.model_time_constant),
        highest_torque=limits.torque,
        torque_ticks=to_ticks(settings.torque_time),
        command_gain=min(1.0, TICK / settings.command_time_constant),
        highest_current=settings.current_share * limits.current,
        heating=cooling / (continuous * continuous),
        cooling=cooling,
        drive_ticks=to_ticks(settings.drive_time),
        emf_constant=motor.torque_constant * motor.gear_ratio,
        model_resistance=settings.model_resistance_ratio * resistance,
    )


def _network(setup: SimulationSetup, parameters: NetworkParameters) -> episode.Network:
    boards = [f"{joint.side}_{joint.joint}" for joint in setup.joints]
    messages = bus_messages(setup.experiment)
    frames, delay = cyclic_messages(messages, boards), setup.bus_delay
    capacity = (delay // _DELAY_PADDING + 1) * _DELAY_PADDING

    def channels(kind: str) -> list[episode.CanChannel]:
        carried = [messages[f"{board}_{kind}"] for board in boards]
        entries = [(frames.index(message), message.layout) for message in carried]
        return [
            episode.CanChannel(index, layout, [episode.ReceivedFrame() for _ in range(capacity)])
            for index, layout in entries
        ]

    return episode.Network(
        bus=new_bus(parameters, messages, boards, setup.experiment.seed, TICK),
        delay=delay,
        setpoints=channels(SETPOINT_SUFFIX),
        measurements=channels(MEASUREMENT_SUFFIX),
        numbers=[0.0] * max(len(message.signals) for message in frames),
    )


def _requests(setup: SimulationSetup) -> list[episode.TimedCommand]:
    """Return the requests of the experiment, padded so that lists of similar length share one loop."""
    modes, requests = setup.experiment.modes, setup.experiment.requests
    if modes is None:
        return []
    commands = [episode.TimedCommand(item.ticks, 1 + modes.requests.index(item.name)) for item in requests]
    return _padded_list(commands, episode.TimedCommand())


def _trunk_unit(setup: SimulationSetup) -> TrunkUnit:
    """Return the inertial measurement unit of the trunk; its initial estimate of the pitch is exact."""
    sensor, index = setup.experiment.sensors.trunk, setup.world.model.pitch_index
    gain, pitch = first_order_gain(TICK, sensor.time_constant), float(setup.world.start_q[index])
    return from_attributes(TrunkUnit, sensor, gain=gain, pitch=pitch)
