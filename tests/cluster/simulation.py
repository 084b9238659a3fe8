"""A frame in parts on many nodes, event by event: what it takes with slow nodes and with nodes that fail.

All times are seconds. Random numbers come from the generator that the caller seeds, so that the same seed gives the same run.
"""

import heapq
import math
import sys
from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """Work as one node does it.

    `work`: all samples, but for learning. `learning`: what has to be learned before any part can begin, on one node.
    """

    work: float
    learning: float = 0.0


@dataclass(frozen=True)
class Costs:
    """What dividing costs.

    `part`: each part, for its start, the scene, and writing. `dispatch`: from the end of a task to the begin of the next on its node.
    `merge` and `merge_part`: a merge, and what each part adds to it. `merged`: parts that are merged at a time, to the sum of those before.
    """

    part: float = 0.0
    dispatch: float = 0.0
    merge: float = 0.0
    merge_part: float = 0.0
    merged: int = sys.maxsize

    def merging(self, parts):
        """Seconds of a merge of so many parts."""
        return self.merge + self.merge_part * parts

    def merges(self, parts):
        """Numbers of parts of the merges, in their order."""
        return [min(self.merged, parts - first) for first in range(0, parts, self.merged)]


@dataclass(frozen=True)
class Cluster:
    """Nodes and what happens to them.

    `slow_nodes`, `slow_tasks`: how uneven nodes are, and tasks on the same node: standard deviation of the logarithm of a log-normal slowdown
    whose mean is 1. `between_failures`: mean time between two failures of a node, exponentially distributed. A part that a failure ends
    has lost what it did since its last checkpoint (`checkpoints` apart), and may begin again `requeue` later; the node is back after `repair`.
    """

    nodes: int
    slow_nodes: float = 0.0
    slow_tasks: float = 0.0
    between_failures: float = math.inf
    checkpoints: float = math.inf
    requeue: float = 0.0
    repair: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """`time`: from the begin of learning to the merged picture. `busy`: node seconds that were asked for. `failures`: parts that were cut short."""

    time: float
    busy: float
    failures: int


def exact_time(frame, costs, nodes, parts):
    """What `run` gives where all nodes are alike, none fails, and all parts are merged at the end."""
    rounds = math.ceil(parts / nodes)
    return frame.learning + rounds * (costs.dispatch + costs.part + frame.work / parts) + costs.dispatch + costs.merging(parts)


def slowdown(spread, random):
    return math.exp(random.gauss(0, spread) - spread**2 / 2) if spread else 1.0


class Nodes:
    """When nodes are free, how slow they are, and when they fail next."""

    def __init__(self, cluster, begin, random):
        self.cluster, self.random = cluster, random
        self.free = [(begin, node) for node in range(cluster.nodes)]
        self.slowness = [slowdown(cluster.slow_nodes, random) for _ in self.free]
        self.failure = [begin + self.until_failure() for _ in self.free]

    def until_failure(self):
        mean = self.cluster.between_failures
        return self.random.expovariate(1 / mean) if math.isfinite(mean) else math.inf

    def fail(self, node):
        """The node is back after its repair; returns when."""
        back = self.failure[node] + self.cluster.repair
        self.failure[node] = back + self.until_failure()
        return back

    def take(self, ready):
        """The node that is free first, and from when on, no earlier than `ready`; failures of idle nodes are behind it then."""
        while True:
            free, node = heapq.heappop(self.free)
            begin = max(free, ready)
            if self.failure[node] > begin:
                return begin, node
            heapq.heappush(self.free, (self.fail(node), node))

    def give_back(self, node, time):
        heapq.heappush(self.free, (time, node))


class Queue:
    """Tasks in the order in which they were submitted, as soon as each may begin."""

    def __init__(self):
        self.coming, self.waiting = [], []

    def __bool__(self):
        return bool(self.coming or self.waiting)

    def add(self, ready, rank, left):
        heapq.heappush(self.coming, (ready, rank, left))

    def first(self):
        """When a task may begin at the earliest."""
        return 0.0 if self.waiting else self.coming[0][0]

    def take(self, now):
        """The first of those that may begin now: its rank and what is left of its work."""
        while self.coming and self.coming[0][0] <= now:
            heapq.heappush(self.waiting, heapq.heappop(self.coming)[1:])
        return heapq.heappop(self.waiting)


def run(frame, costs, cluster, parts, random):
    """Learns, renders `parts` parts and merges them, once. A merge waits for its parts and for the merge before."""
    nodes, queue = Nodes(cluster, frame.learning, random), Queue()
    merges = costs.merges(parts)
    # Parts that each merge waits for, and when the last task that it waits for has ended.
    missing, last = list(merges), [frame.learning] * len(merges)
    for part in range(parts):
        # The rank of a part is that of its merge, which is submitted behind it.
        queue.add(frame.learning, (part // costs.merged, 0, part), frame.work / parts)
    merged, busy, failures = 0, frame.learning, 0
    while queue:
        begin, node = nodes.take(queue.first())
        rank, left = queue.take(begin)
        group, is_merge, _ = rank
        begin += costs.dispatch
        if is_merge:
            pace, fixed = 1.0, costs.merging(merges[group])
        else:
            pace, fixed = nodes.slowness[node] * slowdown(cluster.slow_tasks, random), costs.part
        done = begin + fixed + left * pace
        failed = nodes.failure[node]
        if failed < done:
            failures += 1
            busy += max(failed - begin, 0)
            queue.add(failed + cluster.requeue, rank, left - kept(failed - begin - fixed, pace, cluster.checkpoints))
            nodes.give_back(node, nodes.fail(node))
            continue
        nodes.give_back(node, done)
        busy += done - begin
        if is_merge:
            merged = group + 1
            if merged < len(merges):
                last[merged] = max(last[merged], done)
        else:
            missing[group] -= 1
            last[group] = max(last[group], done)
        # The next merge, where it is its turn and its last part has ended.
        if merged < len(merges) and missing[merged] == 0 and (is_merge or group == merged):
            queue.add(last[merged], (merged, 1, 0), 0.0)
    # The last merge waits for everything.
    return Outcome(done, busy, failures)


def kept(traced, pace, checkpoints):
    """Work in the last checkpoint after so many seconds of tracing."""
    if traced < checkpoints:
        return 0.0
    return math.floor(traced / checkpoints) * checkpoints / pace
