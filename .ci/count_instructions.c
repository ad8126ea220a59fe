// A plugin of QEMU: the instructions that the emulated program runs between two calls of a function named *instructions_mark*,
// a line a call in the file that `out=` names. QEMU's plugin interface, of which this is all that is needed, has no header in
// its packages; -DVERSION is the interface's version.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t id;
struct block;
struct instruction;
size_t qemu_plugin_tb_n_insns(const struct block *);
struct instruction *qemu_plugin_tb_get_insn(const struct block *, size_t);
uint64_t qemu_plugin_insn_vaddr(const struct instruction *);
const char *qemu_plugin_insn_symbol(const struct instruction *);
void qemu_plugin_register_vcpu_tb_trans_cb(id, void (*)(id, struct block *));
void qemu_plugin_register_vcpu_tb_exec_cb(struct block *, void (*)(unsigned, void *), int flags, void *);

__attribute__((visibility("default"))) int qemu_plugin_version = VERSION;

// The emulated program has one thread.
static uint64_t count, counted;
static FILE *out;

static void on_block(unsigned processor, void *instructions) { count += (uintptr_t)instructions; }

static void on_mark(unsigned processor, void *instructions) {
    fprintf(out, "%llu\n", (unsigned long long)(count - counted));
    fflush(out);
    counted = count;
}

static void on_translated(id plugin, struct block *block) {
    const struct instruction *first = qemu_plugin_tb_get_insn(block, 0);
    // Where the function was entered: its first block is the first to be translated.
    static uint64_t entry;
    const char *name = qemu_plugin_insn_symbol(first);
    if (!entry && name && strstr(name, "instructions_mark")) entry = qemu_plugin_insn_vaddr(first);
    void *instructions = (void *)(uintptr_t)qemu_plugin_tb_n_insns(block);
    qemu_plugin_register_vcpu_tb_exec_cb(block, on_block, 0, instructions);
    if (qemu_plugin_insn_vaddr(first) == entry) qemu_plugin_register_vcpu_tb_exec_cb(block, on_mark, 0, NULL);
}

__attribute__((visibility("default"))) int qemu_plugin_install(id plugin, const void *info, int count, char **arguments) {
    if (count != 1 || strncmp(arguments[0], "out=", 4) || !(out = fopen(arguments[0] + 4, "w"))) return 1;
    qemu_plugin_register_vcpu_tb_trans_cb(plugin, on_translated);
    return 0;
}
