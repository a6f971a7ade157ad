"""Memory of instances and their states: copies of the unit's image, whose addresses within themselves are made those of the copy.

An instance is an address within a block: words of the interface come before it. `model`: words of a block, words of the image, number of
addresses, the image, indices of the addresses, characters of the token, 0.
"""

from __future__ import annotations

from compiler.api import Bytes, Ints, Record, record_of

from .instance import ERROR, OK, FmuInstance

BEFORE = 4  # words before an instance
# their places: function for messages, what the importer wants to have back, name of the instance
LOGGER, ENVIRONMENT, NAME = -4, -3, -2
HEAD = 3  # words of a model before the image
MAKES_STEPS, MESSAGE = (record_of(FmuInstance).place(name) for name in ("makes_steps", "message"))


class StatePlace(Record):
    """Place of an importer for the address of a state."""

    block: Ints


def calloc(count: int, size: int) -> Ints:
    """Get memory from the system."""
    raise NotImplementedError


def free(block: Ints) -> None:
    """Give it back."""
    raise NotImplementedError


def memcpy(to: Ints, source: Ints, size: int) -> None:
    """Copy bytes."""
    raise NotImplementedError


def strlen(text: Ints) -> int:
    """Return the number of bytes before the 0 of a text."""
    raise NotImplementedError


def fmu_connect(block: Ints) -> None:
    """Put the addresses of the model's functions into a block."""
    raise NotImplementedError


def fmu_log(own: Ints, status: int, number: int) -> None:
    """Hand a message to the importer; `own`: the words before an instance."""
    raise NotImplementedError


def tell(c: Ints, status: int) -> int:
    """Hand the message of an instance to the importer; return the status."""
    number = c[MESSAGE]
    c[MESSAGE] = 0
    if number != 0 and c[LOGGER] != 0:
        fmu_log(c[LOGGER:], status, number)
    return status


def place_inside(block: Ints, address: int, model: Ints) -> None:
    """Put the addresses within a block of memory: the image has them as if the block began at 0."""
    image = model[HEAD:]
    inside = image[model[1] :]
    for k in range(model[2]):
        block[inside[k]] = image[inside[k]] + address


def place_all(block: Ints, model: Ints) -> None:
    """Put all addresses into a block."""
    place_inside(block, id(block), model)
    fmu_connect(block)


def prepare(c: Ints, model: Ints) -> int:
    """Prepare a new instance of the same kind."""
    steps = c[MAKES_STEPS]
    memcpy(c, model[HEAD:], 8 * model[1])
    for k in range(model[1], model[0]):
        c[k] = 0
    place_all(c, model)
    c[MAKES_STEPS] = steps
    return OK


def is_token(text: Bytes, own: Ints) -> bool:
    """Return True if a text is the token of this unit."""
    k = 0
    while own[k] != 0:
        if text[k] != own[k]:
            return False
        k += 1
    return text[k] == 0


def instantiate(name: Ints, token: Bytes, model: Ints, steps: int, logger: int, environment: int) -> int:
    """Return the address of a new instance; 0 for a token of another unit, and without memory. `steps`: as `makes_steps`."""
    if not is_token(token, model[HEAD + model[1] + model[2] :]):
        return 0
    words = BEFORE + model[0]
    length = strlen(name) + 1
    memory = calloc(words + length // 8 + 1, 8)
    if id(memory) == 0:
        return 0
    memcpy(memory[words:], name, length)
    c = memory[BEFORE:]
    c[LOGGER] = logger
    c[ENVIRONMENT] = environment
    c[NAME] = id(memory[words:])
    c[MAKES_STEPS] = steps
    prepare(c, model)
    return id(c)


def instantiate_2(name: Ints, kind: int, token: Bytes, callbacks: Ints, model: Ints) -> int:
    """Return the address of a new instance of FMI 2.0; the structure of the importer has its function first and its environment last."""
    return instantiate(name, token, model, kind, callbacks[0], callbacks[4])


def instantiate_3(name: Ints, token: Bytes, environment: Ints, logger: Ints, model: Ints) -> int:
    """Return the address of a new instance for model exchange of FMI 3.0."""
    return instantiate(name, token, model, 0, id(logger), id(environment))


def nothing(model: Ints) -> int:
    """Return no instance."""
    return 0


def instantiate_steps_3(
    name: Ints, token: Bytes, event_mode: int, early: int, environment: Ints, logger: Ints, model: Ints
) -> int:
    """Return the address of a new instance for co-simulation of FMI 3.0."""
    return instantiate(name, token, model, 1 + 2 * event_mode + 4 * early, id(logger), id(environment))


def release(c: Ints) -> None:
    """End an instance."""
    if id(c) != 0:
        free(c[-BEFORE:])


def get_state(c: Ints, state: StatePlace, model: Ints) -> int:
    """Copy an instance, to a new state if there is none."""
    if id(state.block) == 0:
        state.block = calloc(model[0], 8)
    if id(state.block) == 0:
        return ERROR
    memcpy(state.block, c, 8 * model[0])
    return OK


def set_state(c: Ints, state: Ints, model: Ints) -> int:
    """Copy a state to an instance, which stays of its kind."""
    steps = c[MAKES_STEPS]
    memcpy(c, state, 8 * model[0])
    place_all(c, model)
    c[MAKES_STEPS] = steps
    return OK


def free_state(state: StatePlace, addresses: Ints) -> int:
    """End a state. `addresses`: the same place as an array."""
    free(state.block)
    addresses[0] = 0
    return OK


def get_size(size: Ints, model: Ints) -> int:
    """Tell how many bytes a state has."""
    size[0] = 8 * model[0]
    return OK


def serialize(state: Ints, data: Ints, size: int, model: Ints) -> int:
    """Copy a state to bytes, without addresses of this process."""
    if size < 8 * model[0]:
        return ERROR
    memcpy(data, state, 8 * model[0])
    place_inside(data, 0, model)
    return OK


def deserialize(data: Ints, size: int, state: StatePlace, model: Ints) -> int:
    """Copy bytes to a new state."""
    if size != 8 * model[0]:
        return ERROR
    state.block = calloc(model[0], 8)
    if id(state.block) == 0:
        return ERROR
    memcpy(state.block, data, size)
    return OK


def do_nothing(c: Ints) -> int:
    """Do nothing."""
    return OK
